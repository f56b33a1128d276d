"""Which data set a folder looks like, for what is said of a folder that is not understood."""

from __future__ import annotations

from pathlib import Path

IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm"}
VIDEOS = {".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v"}
SIGNS: dict[str, tuple[tuple[str, ...], ...]] = {
    "seven_scenes": (("frame-*.depth.png",),),
    "tum": (("rgb.txt",), ("img_curr*.png", "img_prev*.png")),
    "kitti": (("calib.txt", "image_0"), ("calib.txt", "image_2"), ("calib.txt", "image_l")),
    "spherical": (("sphere_*", "Extrinsics"), ("image_*.png", "range_*.png"), ("image_*.jpg", "range_*.png")),
}  # format -> alternatives, of which all names must be there


def guess_format(folder: Path) -> str:
    """Return the format whose files are in the folder; empty: none of SIGNS."""
    for name, alternatives in SIGNS.items():
        if any(all(any(folder.glob(sign)) for sign in signs) for signs in alternatives):
            return name
    return ""


def describe_folder(folder: Path) -> str:
    """Return in words what a folder is, or holds where that is not known."""
    if not folder.is_dir():
        return ""
    if name := guess_format(folder):
        return f"the folder looks like {name}"
    below = sorted(path for path in folder.iterdir() if path.is_dir())
    for path in below:
        if name := guess_format(path):
            return f"{path} looks like {name}"
    if any(path.suffix.lower() in IMAGES | VIDEOS for place in (folder, *below) for path in place.iterdir()):
        return "it has images"
    found = ", ".join(path.name for path in sorted(folder.iterdir())[:5]) or "nothing"
    return f"the folder holds {found}"
