"""From the last image to this one."""
