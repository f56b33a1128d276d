"""What a camera would see from anywhere near key spheres. READ FIRST `synthesis.py`; `surface.py` is what it draws."""
