"""The map in force, and the call that loads another one."""

from __future__ import annotations

import time
from collections.abc import Callable

from sphere_nav_msgs.srv import LoadMap

from sphere_nav.geometry.cameras.rig import Rig
from sphere_nav.geometry.files.rig_file import parse_rig, read_rig
from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.ros.service import one_line

IN_MAP = "map"
UNREADABLE = "path: expected a map, found none that can be read: the log of dense_localizer says why"


class Maps:
    """Holds one open map. What cannot be read leaves the present one in force."""

    def __init__(self, endpoints: Endpoints, use: Callable[[MapReader], object]) -> None:
        """`use(reader)` is called with every map that was opened; ValueError refuses the map."""
        self._use, self._log = use, endpoints.log
        self.reader: MapReader | None = None
        endpoints.add_service("~/load_map", LoadMap, self.on_load_map)

    def open(self, path: str) -> MapReader:
        """Use another map; ValueError or OSError for one that cannot be read."""
        return self._take(open_map(path, is_gray=True))

    def _take(self, reader: MapReader) -> MapReader:
        before = self.reader
        try:
            self._use(reader)
        except BaseException:
            reader.close()
            raise
        self.reader = reader
        if before is not None:
            before.close()
        return reader

    def close(self) -> None:
        """Close the map."""
        if self.reader is not None:
            self.reader.close()
        self.reader = None

    def on_load_map(self, request: LoadMap.Request, response: LoadMap.Response) -> LoadMap.Response:
        """Use another map, and say what is in it; of a file that is none nothing is told to who asks."""
        started = time.perf_counter()
        try:
            reader = open_map(request.path, is_gray=True)
        except (ValueError, OSError) as error:
            self._log.warning(f"load_map: {one_line(error)}")
            response.message = UNREADABLE
            return response
        try:
            self._take(reader)
        except (ValueError, OSError) as error:
            response.message = one_line(error)
            return response
        response.success, response.map_id = True, str(reader.info.map_id)
        response.num_spheres, response.num_edges = len(reader.graph), len(reader.graph.edges)
        response.seconds = time.perf_counter() - started
        response.message = f"{response.num_spheres} key spheres of {request.path}"
        return response


def read_calibration(where: str, reader: MapReader | None) -> Rig | None:
    """Return the rig of a file, or with the word `map` that of the map; None for no word. ValueError: there is none."""
    if where != IN_MAP:
        return read_rig(where) if where else None
    if reader is None or not reader.info.rig:
        raise ValueError("rig.calibration: expected a map with the calibration of its rig, found none")
    return parse_rig(reader.info.rig, "rig of the map")
