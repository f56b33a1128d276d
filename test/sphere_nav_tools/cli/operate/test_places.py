"""Places of the map in use: none without a taught path. Naming and ways are driven in test_page."""

import pytest

from sphere_nav_tools.cli.operate.places import network_of


def test_a_map_without_a_taught_path_has_no_places(tmp_path):
    with pytest.raises(ValueError, match="expected a map with a taught path, found none"):
        network_of(tmp_path, None)
