"""The calls of an operator: load_map, relocalize, reset."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from sphere_nav_msgs.srv import LoadMap, Relocalize
from std_srvs.srv import Trigger

from localization.status import FOLLOWING, describe
from node_kit import conversions

if TYPE_CHECKING:
    from dense_localizer.node import DenseLocalizerNode


class OperatorCalls:
    """Services of a node; each answers in one line what happened."""

    def __init__(self, node: DenseLocalizerNode) -> None:
        self._node = node
        node.add_service("load_map", LoadMap, self.on_load_map)
        node.add_service("relocalize", Relocalize, self.on_relocalize)
        node.add_service("reset", Trigger, self.on_reset)

    def on_load_map(self, request: LoadMap.Request, response: LoadMap.Response) -> LoadMap.Response:
        """Use another map; a map that cannot be read leaves the present one in force."""
        started, node = time.perf_counter(), self._node
        try:
            node.load_map(request.path)
        except (ValueError, OSError) as error:
            response.message = " ".join(str(error).split())
            return response
        assert node.map is not None
        response.success, response.map_id = True, str(node.map.info.map_id)
        response.num_spheres, response.num_edges = len(node.map.graph), len(node.map.graph.edges)
        response.seconds = time.perf_counter() - started
        response.message = f"{response.num_spheres} key spheres of {request.path}"
        return response

    def on_relocalize(self, request: Relocalize.Request, response: Relocalize.Response) -> Relocalize.Response:
        """Search with the last image, and go on with the next ones where it is not found."""
        started, node = time.perf_counter(), self._node
        T_base_camera = node.intake.T_base_camera
        try:
            if node.localizer is None:
                raise ValueError("relocalize: expected a map, found none: load one first")
            guess = None
            if request.has_guess:
                guess, _ = conversions.pose_with_covariance_to_se3(request.guess, node.params.map_frame)
            estimate = node.localizer.relocalize(guess @ T_base_camera if guess is not None else None)
        except ValueError as error:
            response.message = str(error)
            return response
        response.seconds = time.perf_counter() - started
        if estimate is None:
            response.message = "no image yet: the search begins with the next one"
            return response
        node.outputs.tell(estimate.status)
        response.success = estimate.status.state in FOLLOWING
        response.message, response.quality = describe(estimate.status), estimate.status.quality
        response.references = list(estimate.status.references)
        place = estimate.place
        if response.success and place is not None:
            covariance = conversions.moved_covariance(place.covariance, T_base_camera)
            T_map_base, stamp = place.T_map_camera @ T_base_camera.inverse(), estimate.status.stamp_ns
            frame = node.params.map_frame
            response.pose = conversions.se3_to_pose_with_covariance(T_map_base, covariance, stamp, frame)
        return response

    def on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget the pose, the stream and the calibration."""
        node = self._node
        node.clock_jumped()
        node.intake.forget_camera()
        response.success, response.message = True, "nothing is known of the pose"
        return response
