"""From the last image to this one; depth where grey levels do not do."""
