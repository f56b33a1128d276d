"""What `sphere_nav demo` is made of: processes, a watch over the drives, and the report."""
