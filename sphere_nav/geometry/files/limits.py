"""What may come from outside at most, in a file or in a message: more is refused before anything is allocated.

One table for all readers; `cameras/camera.py` bounds images, `untrusted.py` text and numbers.
"""

from __future__ import annotations

LIMITS = {
    "image file": 1 << 28,  # bytes
    "cloud": 1 << 28,  # bytes of a message
    "sphere": 1 << 25,  # pixels: 8192 x 4096
    "features": 100_000,  # of a key sphere
    "bag": 1 << 50,  # bytes of a file: any that a disk holds
    "routes": 256 << 20,  # bytes of a network: 10 km are about 6 MB
}
