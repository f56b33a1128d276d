"""What `sphere_nav demo` is made of: the stages, and a watch over the drives."""
