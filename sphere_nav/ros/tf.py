"""/tf and /tf_static: a tree of frames, heard and told. tf2 itself is C++ and not needed for so little."""

from __future__ import annotations

import math
from functools import partial
from typing import Protocol

from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
from sphere_nav.geometry.odometry import PoseBuffer, move_on
from sphere_nav.ros import qos
from sphere_nav.ros.constants import LOG_PERIOD_S, PARENT_HOLD_NS, SAME_POSE, TF_MEMORY_NS
from sphere_nav.ros.conversions import stamp_ns, transform_to_se3
from sphere_nav.ros.endpoints import WARN, Endpoints

MAX_DEPTH = 100  # frames up to the root
MAX_FRAMES = 10_000  # a robot has some dozens; more would fill the memory


class TransformError(ValueError):
    """Why a transform cannot be told: unknown frame, two trees, or a stamp outside of what was heard."""


class TransformTree:
    """Frames by name; static ones hold for ever, others are interpolated between stamps and forgotten after 10 s.

    A frame has one parent. Of several static ones the latest holds, and a static one before one that moves. Of several
    that move the one that is there holds until its stamps have ended for `PARENT_HOLD_NS`, or until time starts again.
    What would close a loop is refused.
    """

    def __init__(self, memory_ns: int = TF_MEMORY_NS) -> None:
        self._memory_ns = memory_ns
        self._parents: dict[str, str] = {}
        self._static: dict[str, SE3] = {}
        self._moving: dict[str, PoseBuffer[None]] = {}

    def add(self, message: TransformStamped, *, is_static: bool = False) -> str:
        """Add T_parent_child; return what had to give way for it in one line, mostly nothing.

        ValueError for a NaN, an empty name, a frame below itself, or a second parent where the first one holds.
        """
        parent, child = message.header.frame_id, message.child_frame_id
        if not parent or not child or parent == child:
            raise ValueError(f"transform: expected two frames, found {parent!r} and {child!r}")
        T_parent_child = transform_to_se3(message.transform, f"transform {parent} -> {child}")
        stamp = stamp_ns(message)
        line = self._make_way(parent, child, None if is_static else stamp)
        if is_static:
            held = self._static.get(child, T_parent_child)
            self._static[child] = T_parent_child
            return line or _told_anew(f"transform {parent} -> {child}", held, T_parent_child)
        self._remember(child, stamp, T_parent_child)
        return line

    def _make_way(self, parent: str, child: str, stamp: int | None) -> str:
        """Set the parent of a frame where the tree stays a tree. `stamp`: of one that moves; None: static."""
        held = self._parents.get(child)
        if held == parent:
            return ""
        above = self._chain(parent)
        if len(above) >= MAX_DEPTH:
            raise ValueError(f"transform: {parent} -> {child}: expected at most {MAX_DEPTH} frames up to the root")
        if held is None and len(self._parents) >= MAX_FRAMES:
            raise ValueError(f"transform: {parent} -> {child}: expected at most {MAX_FRAMES} frames")
        if held is not None and not self._gives_way(child, stamp):
            raise ValueError(f"transform: {child}: expected parent {held}, found a second one, {parent}")
        if child in above:
            raise ValueError(f"transform: {parent} -> {child}: expected no loop, found {child} above {parent}")
        self._forget(child)
        self._parents[child] = parent
        return "" if held is None else f"transform: {child}: parent {held} is replaced by {parent}"

    def _gives_way(self, child: str, stamp: int | None) -> bool:
        """Whether the parent of a frame gives way to another edge: at a stamp in ns, or static (None)."""
        if stamp is None or child in self._static:
            return stamp is None
        history = self._moving.get(child)
        return not history or not -self._memory_ns <= stamp - history[-1][0] <= PARENT_HOLD_NS

    def _forget(self, child: str) -> None:
        self._parents.pop(child, None)
        self._static.pop(child, None)
        self._moving.pop(child, None)

    def lookup(self, target: str, source: str, stamp: int | None = None) -> SE3:
        """Return T_target_source at a stamp in ns (None: the newest); TransformError says why not."""
        up_source, up_target = self._ancestors(source), self._ancestors(target)
        common = next((frame for frame in up_source if frame in up_target), None)
        if common is None:
            raise TransformError(
                f"tf: {target} and {source} are not connected: {self._hint(target)}, {self._hint(source)}"
            )
        return self._climb(target, common, stamp).inverse() @ self._climb(source, common, stamp)

    def is_connected(self, target: str, source: str) -> bool:
        """Whether two frames are of one tree, or are one."""
        return target == source or self.root(target) == self.root(source)

    def clear(self) -> None:
        """Forget everything that moves: the clock jumped."""
        self._moving.clear()

    def _remember(self, child: str, stamp: int, T_parent_child: SE3) -> None:
        history = self._moving.setdefault(child, PoseBuffer())
        if history and stamp < history[-1][0]:
            if history[-1][0] - stamp > self._memory_ns:
                history.clear()
            else:
                return
        if not history or stamp > history[-1][0]:
            history.append((stamp, T_parent_child, None))
        while stamp - history[0][0] > self._memory_ns:
            history.popleft()

    def root(self, frame: str) -> str:
        """Return the frame above all others of a frame's tree: itself where none is known."""
        return self._chain(frame)[-1]

    def is_moving(self, frame: str) -> bool:
        """Whether a frame moves in its root: not all that lies between is static."""
        return any(child not in self._static for child in self._chain(frame)[:-1])

    def moving_edge(self, frame: str) -> tuple[str, str] | None:
        """Return parent and child of the first edge that moves, from a frame up; None where nothing moves."""
        child = next((child for child in self._chain(frame)[:-1] if child not in self._static), None)
        return None if child is None else (self._parents[child], child)

    def carry_on(self, child: str, stamp: int, max_age_ns: int) -> SE3 | None:
        """Return T_parent_child of a frame that moves at a stamp in ns, for a short time as it moved last."""
        history = self._moving.get(child) or PoseBuffer[None]()
        if len(history) < 2 or not history[0][0] <= stamp <= history[-1][0] + max_age_ns:
            return None
        if stamp <= history[-1][0]:
            return self._one(child, stamp)
        before = next((entry for entry in reversed(history) if history[-1][0] - entry[0] >= max_age_ns), history[0])
        return move_on(before[1], history[-1][1], (stamp - before[0]) / (history[-1][0] - before[0]))

    def _chain(self, frame: str) -> list[str]:
        chain = [frame]
        while chain[-1] in self._parents and len(chain) < MAX_DEPTH:
            chain.append(self._parents[chain[-1]])
        return chain

    def _climb(self, frame: str, ancestor: str, stamp: int | None) -> SE3:
        """Return T_ancestor_frame."""
        pose = SE3.identity()
        while frame != ancestor:
            pose = self._one(frame, stamp) @ pose
            frame = self._parents[frame]
        return pose

    def _one(self, child: str, stamp: int | None) -> SE3:
        if child in self._static:
            return self._static[child]
        history = self._moving.get(child)
        name = f"tf: {self._parents[child]} -> {child}"
        if not history:
            raise TransformError(f"{name}: nothing heard since the clock jumped")
        if stamp is None:
            return history[-1][1]
        known = history.at(stamp)
        if known is None:
            late = (stamp - history[-1 if stamp > history[-1][0] else 0][0]) / 1e9
            raise TransformError(f"{name}: expected stamp {stamp / 1e9:.3f} s, found up to {late:+.3f} s away")
        return known[0]

    def _ancestors(self, frame: str) -> list[str]:
        known = frame in self._parents or frame in self._parents.values()
        if not known:
            frames = sorted({*self._parents, *self._parents.values()})
            raise TransformError(
                f"tf: frame {frame}: expected one of {', '.join(frames) or '(none heard)'}, found none"
            )
        return self._chain(frame)

    def _hint(self, frame: str) -> str:
        return f"{frame} is below {self._ancestors(frame)[-1]}"


def _told_anew(name: str, held: SE3, told: SE3) -> str:
    """Return that a frame which stands still is elsewhere now; nothing where it is where it was."""
    metres, radians = held.distance(told)
    if max(metres, radians) < SAME_POSE:
        return ""
    return f"{name}: told twice, {metres:.3f} m and {math.degrees(radians):.1f} deg apart: the later one holds"


class Transforms(Protocol):
    """What tells where frames are."""

    def lookup(self, target: str, source: str, stamp: int | None = None) -> SE3:
        """Return T_target_source; TransformError says why not."""
        ...


class TransformListener:
    """A tree that hears `/tf` and `/tf_static`; `lookup` is what to ask.

    What is below the frame `ignored` is not heard: a node that publishes it would hear itself.
    """

    def __init__(self, endpoints: Endpoints, *, is_required: bool = False, ignored: str = "") -> None:
        self.tree, self._ignored = TransformTree(), ignored
        self._endpoints, self._num_changes = endpoints, 0
        moving, static = partial(self._add, is_static=False), partial(self._add, is_static=True)
        endpoints.add_subscription("/tf", TFMessage, moving, qos.TF, is_required=False)
        endpoints.add_subscription("/tf_static", TFMessage, static, qos.TF_STATIC, is_required=is_required, silence=0.0)

    def lookup(self, target: str, source: str, stamp: int | None = None) -> SE3:
        """Return T_target_source; TransformError says why not."""
        return self.tree.lookup(target, source, stamp)

    def _add(self, message: TFMessage, *, is_static: bool) -> None:
        """Add all that can be used, report where a frame has another parent now; ValueError says what was refused."""
        refusals = []
        for transform in message.transforms:
            try:
                if not self._ignored or transform.header.frame_id != self._ignored:
                    self._report(self.tree.add(transform, is_static=is_static), transform.child_frame_id)
            except ValueError as error:
                refusals.append(str(error))
        if refusals:
            raise ValueError("; ".join(refusals))

    def _report(self, change: str, child: str) -> None:
        if change:
            self._num_changes += 1
            self._endpoints.log.warning(change, every=LOG_PERIOD_S, key=f"parent of {child}")
            self._endpoints.report("tf parents", WARN, change, changes=self._num_changes)
