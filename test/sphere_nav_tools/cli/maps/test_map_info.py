"""What is in a map, in words."""

from sphere_nav_tools.cli.maps.map_info import in_words

FACTS = {
    "path": "yard", "map_id": "a1", "format_version": 1, "software": "sphere_nav 0.1.0", "source": "drive",
    "frame": "map", "origin": "", "key_spheres": 12, "edges": 14, "loops": 2, "length_m": 31.416,
    "extent_m": [10.0, 9.5, 0.1], "spacing_m": [0.5, 1.0, 2.0], "region_radius_m": [], "first_stamp_s": 3.2,
    "last_stamp_s": 1700000000.0, "sphere_size": [512, 256], "whole_sphere": False, "pixels_per_degree": 1.42,
    "measured_share": 0.753, "megabytes": 12.5, "megabytes_per_sphere": 1.04, "rig": False,
    "places_by_experiences": {"1": 10, "2": 1},
    "experiences": [
        {"name": "", "drive": "", "first_stamp_s": 3.2, "key_spheres": 10, "images_served": 0.0, "last_served_s": None},
        {
            "name": "night", "drive": "n", "first_stamp_s": 1.7e9, "key_spheres": 2, "images_served": 7.0,
            "last_served_s": 1.7e9,
        },
    ],
}  # fmt: skip


def test_facts_are_words_with_units_and_no_reprs():
    text = "\n".join(in_words(FACTS))
    for words in (
        "3.2 s to 2023-11-14 22:13:20 UTC",
        "31.42 m, within 10.00 x 9.50 x 0.10 m",
        "12, 14 edges, 2 of them loops",
        "0.50 to 2.00 m, median 1.00 m",
        "valid within  not known",
        "10 with 1, 1 with 2",
        "10 key spheres of drive without a name, 3.2 s; placed no image yet",
        "2 key spheres of drive n, 2023-11-14 22:13:20 UTC; placed 7 images, last 2023-11-14",
    ):
        assert words in text
    assert not set("{}[]'") & set(text)
    assert "None" not in text
