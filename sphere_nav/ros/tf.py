"""/tf and /tf_static: a tree of frames, heard and told. tf2 itself is C++ and not needed for so little."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial

from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
from sphere_nav.geometry.odometry import MEMORY_NS, OdometryBuffer, move_on
from sphere_nav.ros import qos
from sphere_nav.ros.constants import LOG_PERIOD_S, PARENT_HOLD_NS, SAME_POSE
from sphere_nav.ros.conversions import stamp_ns, transform_to_se3
from sphere_nav.ros.endpoints import WARN, Endpoints

MAX_DEPTH = 100  # frames up to the root
MAX_FRAMES = 10_000  # a robot has some dozens; more would fill the memory


class TransformError(ValueError):
    """Why a transform cannot be told: unknown frame, two trees, or a stamp outside of what was heard."""


@dataclass
class _Edge:
    """What is above a frame, and where the frame is in that: fixed, or by stamps."""

    parent: str
    fixed: SE3 | None = None
    history: OdometryBuffer = field(default_factory=OdometryBuffer)


class TransformTree:
    """Frames by name; static ones hold for ever, others are interpolated between stamps and forgotten after 10 s.

    A frame has one parent. Of several static ones the latest holds, and a static one before one that moves. Of several
    that move the one that is there holds until its stamps have ended for `PARENT_HOLD_NS`, or until time starts again.
    What would close a loop is refused.
    """

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}  # above each frame

    def add(self, message: TransformStamped, *, is_static: bool = False) -> str:
        """Add T_parent_child; return what had to give way for it in one line, mostly nothing.

        ValueError for a NaN, an empty name, a frame below itself, or a second parent where the first one holds.
        """
        parent, child = message.header.frame_id, message.child_frame_id
        if not parent or not child:
            raise ValueError(f"transform: expected two frames, found {parent!r} and {child!r}")
        T_parent_child = transform_to_se3(message.transform, f"transform {parent} -> {child}")
        stamp = stamp_ns(message)
        line = self._make_way(parent, child, None if is_static else stamp)
        edge = self._edges[child]
        if is_static:
            held, edge.fixed = edge.fixed or T_parent_child, T_parent_child
            return line or _told_anew(f"transform {parent} -> {child}", held, T_parent_child)
        edge.history.add(stamp, T_parent_child)
        return line

    def _make_way(self, parent: str, child: str, stamp: int | None) -> str:
        """Set the parent of a frame where the tree stays a tree. `stamp`: of one that moves; None: static."""
        held = self._edges.get(child)
        if held and held.parent == parent:
            return ""
        above = self._chain(parent)
        if len(above) >= MAX_DEPTH:
            raise ValueError(f"transform: {parent} -> {child}: expected at most {MAX_DEPTH} frames up to the root")
        if not held and len(self._edges) >= MAX_FRAMES:
            raise ValueError(f"transform: {parent} -> {child}: expected at most {MAX_FRAMES} frames")
        if held and not _gives_way(held, stamp):
            raise ValueError(f"transform: {child}: expected parent {held.parent}, found a second one, {parent}")
        if child in above:
            raise ValueError(f"transform: {parent} -> {child}: expected no loop, found {child} above {parent}")
        self._edges[child] = _Edge(parent)
        return f"transform: {child}: parent {held.parent} is replaced by {parent}" if held else ""

    def lookup(self, target: str, source: str, stamp: int | None = None) -> SE3:
        """Return T_target_source at a stamp in ns (None: the newest); TransformError says why not."""
        up_source, up_target = self._ancestors(source), self._ancestors(target)
        common = next((frame for frame in up_source if frame in up_target), None)
        if common is None:
            below = f"{target} is below {up_target[-1]}, {source} is below {up_source[-1]}"
            raise TransformError(f"tf: {target} and {source} are not connected: {below}")
        return self._climb(target, common, stamp).inverse() @ self._climb(source, common, stamp)

    def is_connected(self, target: str, source: str) -> bool:
        """Whether two frames are of one tree, or are one."""
        return self.root(target) == self.root(source)

    def clear(self) -> None:
        """Forget everything that moves: the clock jumped."""
        for edge in self._edges.values():
            edge.history.clear()

    def root(self, frame: str) -> str:
        """Return the frame above all others of a frame's tree: itself where none is known."""
        return self._chain(frame)[-1]

    def moving_edge(self, frame: str) -> tuple[str, str] | None:
        """Return parent and child of the first edge that moves, from a frame up; None where nothing moves."""
        moving = (child for child in self._chain(frame)[:-1] if self._edges[child].fixed is None)
        return next(((self._edges[child].parent, child) for child in moving), None)

    def carry_on(self, child: str, stamp: int, max_age_ns: int) -> SE3 | None:
        """Return T_parent_child of a frame that moves at a stamp in ns, for a short time as it moved last."""
        history = self._edges[child].history
        if len(history) < 2 or not history[0][0] <= stamp <= history[-1][0] + max_age_ns:
            return None
        if stamp <= history[-1][0]:
            return self._one(child, stamp)
        last_ns, last, _ = history[-1]
        before_ns, before, _ = next((one for one in reversed(history) if last_ns - one[0] >= max_age_ns), history[0])
        return move_on(before, last, (stamp - before_ns) / (last_ns - before_ns))

    def _chain(self, frame: str) -> list[str]:
        chain = [frame]
        while chain[-1] in self._edges:
            chain.append(self._edges[chain[-1]].parent)
        return chain

    def _climb(self, frame: str, ancestor: str, stamp: int | None) -> SE3:
        """Return T_ancestor_frame."""
        pose = SE3.identity()
        while frame != ancestor:
            pose = self._one(frame, stamp) @ pose
            frame = self._edges[frame].parent
        return pose

    def _one(self, child: str, stamp: int | None) -> SE3:
        edge = self._edges[child]
        if edge.fixed is not None:
            return edge.fixed
        name = f"tf: {edge.parent} -> {child}"
        if not edge.history:
            raise TransformError(f"{name}: nothing heard since the clock jumped")
        if stamp is None:
            return edge.history[-1][1]
        known = edge.history.at(stamp)
        if known is None:
            late = (stamp - edge.history[-1 if stamp > edge.history[-1][0] else 0][0]) / 1e9
            raise TransformError(f"{name}: expected stamp {stamp / 1e9:.3f} s, found up to {late:+.3f} s away")
        return known[0]

    def _ancestors(self, frame: str) -> list[str]:
        known = {*self._edges, *(edge.parent for edge in self._edges.values())}
        if frame not in known:
            heard = ", ".join(sorted(known)) or "(none heard)"
            raise TransformError(f"tf: frame {frame}: expected one of {heard}, found none")
        return self._chain(frame)


def _gives_way(held: _Edge, stamp: int | None) -> bool:
    """Whether what is above a frame gives way to another edge: at a stamp in ns, or static (None)."""
    if stamp is None or held.fixed is not None:
        return stamp is None
    return not held.history or not -MEMORY_NS <= stamp - held.history[-1][0] <= PARENT_HOLD_NS


def _told_anew(name: str, held: SE3, told: SE3) -> str:
    """Return that a frame which stands still is elsewhere now; nothing where it is where it was."""
    metres, radians = held.distance(told)
    if max(metres, radians) < SAME_POSE:
        return ""
    return f"{name}: told twice, {metres:.3f} m and {math.degrees(radians):.1f} deg apart: the later one holds"


class TransformListener(TransformTree):
    """A tree that hears `/tf` and `/tf_static`.

    What is below the frame `ignored` is not heard: a node that publishes it would hear itself.
    """

    def __init__(self, endpoints: Endpoints, *, ignored: str = "") -> None:
        super().__init__()
        self._ignored, self._endpoints = ignored, endpoints
        moving, static = partial(self._on_message, is_static=False), partial(self._on_message, is_static=True)
        endpoints.add_subscription("/tf", TFMessage, moving, qos.TF, is_required=False)
        endpoints.add_subscription("/tf_static", TFMessage, static, qos.TF_STATIC, is_required=False, silence=0.0)

    def _on_message(self, message: TFMessage, *, is_static: bool) -> None:
        """Add all that can be used, report where a frame has another parent now; ValueError says what was refused."""
        refusals = []
        for transform in message.transforms:
            try:
                if not self._ignored or transform.header.frame_id != self._ignored:
                    change = self.add(transform, is_static=is_static)
                    if change:
                        self._endpoints.tell("tf parents", WARN, change, change, every=LOG_PERIOD_S)
            except ValueError as error:
                refusals.append(str(error))
        if refusals:
            raise ValueError("; ".join(refusals))
