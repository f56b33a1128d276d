"""A plain node beside nodes of ours over real DDS, in one executor."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

from sphere_nav.ros.executor import GuardedExecutor
from sphere_nav.ros.live import LiveShell
from sphere_nav.ros.node import ManagedNode
from worlds.patience import wait_until

PATIENCE = 30.0  # s; discovery takes a fraction of one, on a busy machine several


class Desk:
    """Serves its nodes while it waits."""

    def __init__(self, *nodes: Node, executor: Executor | None = None) -> None:
        self.peer, self.executor = Node("peer"), executor or SingleThreadedExecutor()
        self.nodes = (*nodes, self.peer)
        for node in self.nodes:
            self.executor.add_node(node)

    def until(self, is_done: Callable[[], object]) -> None:
        """Wait until something is so."""
        assert wait_until(is_done, PATIENCE, lambda: self.executor.spin_once(timeout_sec=0.05)), "nothing came in time"

    def close(self) -> None:
        """End the nodes."""
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()


class ShellDesk(Desk):
    """A desk of one node of ours, with some of its parameters."""

    def __init__(self, node_class: type[ManagedNode], **values: object) -> None:
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        self.shell = LiveShell(node_class, parameter_overrides=overrides)
        super().__init__(self.shell, executor=GuardedExecutor(self.shell.failures))
        self.node = self.shell.node

    def done(self, future: Future) -> object:
        """Return the result once it is there."""
        self.until(future.done)
        return future.result()
