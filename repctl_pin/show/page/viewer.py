"""Live viewer of a control loop, shown in the browser; keys and the mouse move its target.

Configurations are sent over a websocket by a server on 127.0.0.1, in a thread of this process. Only
this host can reach the server. The server and its port close with the process. Only pages that the
server itself sent may connect. A pane is the part of the page that shows one arm. The reference
pose is the default configuration of a robot, from its SRDF or else mid-range.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import threading
import webbrowser
from collections.abc import Sequence
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from ...base.arguments import Array, as_int, flag, list_of, list_of_names, require_type, vector
from ...base.errors import InputError
from ...model.arm_links import arm_links
from ...model.base_motion import base_placements
from ...model.length import arm_length
from ...model.several_frames import one_frame
from ...model.surfaces import read_surfaces
from ...model.task import Task, require_task
from ...model.visuals import Visuals
from ...motion import elbow
from ...motion.body_displacement import farthest
from ...paths import TaskPath
from ..palette import BLUE, GREEN, PURPLE, VERMILLION
from ..text.part_names import part_name
from .body_points import body_drift
from .scene import Arm, Frames, animation_page, is_planar, moving_of, poses_of

_HOST = "127.0.0.1"

_MESSAGE = 200
"""Maximum size of a message from the page, bytes; a message for a key has about 30."""


class Viewer:
    """Live viewer of a control loop, one pane per controller.

    It is a context manager: ``with rp.Viewer(task, ["J⁺", "ours"]) as view``.

    Parameters
    ----------
    task
        Task whose joints are shown; other joints stay at the reference pose.
    names
        Names of the controllers.
    path
        Path to draw.
    start : (n,) array
        Start configuration, rad (m for prismatic joints); by default the reference pose.
    port
        Port to listen on; 0 chooses a free one.

    Attributes
    ----------
    url : str
        Address of the page.
    offset : (3,) array
        Displacement of the target by keys or by dragging, m, base axes. Arrow keys move the target
        in the plane of the screen, Page Up and Page Down move it away and nearer, and Home resets
        the displacement to 0. The displacement is at most the arm's length along each axis.

    Raises
    ------
    InputError
        If there is no name, or the port is taken or not allowed.

    Examples
    --------
    >>> with rp.Viewer(task, ["J⁺", "ours"]) as view:
    ...     view.show(q0, q0 + 0.1)  # one configuration per controller, at any rate
    ...     target = task.placement(q0).translation + view.offset  # m, moved by the keys
    """

    def __init__(
        self,
        task: Task,
        names: Sequence[str],
        *,
        path: TaskPath | None = None,
        start: ArrayLike | None = None,
        port: int = 0,
    ) -> None:
        # check the arguments
        one_frame(require_task(task), "a viewer")
        if path is not None:
            require_type(path, TaskPath, "path", "a path, such as rp.circle(task, q0)")
        listed = (
            ()
            if isinstance(names, str)
            else list_of_names(names, "names", "a list of names, one per pane")
        )
        if not listed:
            raise InputError(
                "a viewer requires the controllers' names, one per pane, such as ['J⁺', 'ours']"
            )
        self.task = task
        self.names = listed
        self.offset = np.zeros(3)
        # the page of the arm at its start
        self._visuals = Visuals.of(task.robot)
        self._first: Array | None = None
        q0 = vector(task.reference if start is None else start, task.n, "the start")
        self._reach = arm_length(task, q0) or 1.0
        self._elbow = elbow(task, q0)
        page = self._page(q0, path)
        # serve it from a thread of its own
        try:
            sockets = bind_sockets(as_int(port, "the port", 0, 65535), _HOST)
        except OSError as error:
            raise InputError(
                f"cannot listen on port {port}: {error.strerror}; choose another port, or 0 for any"
            ) from None
        self._port = sockets[0].getsockname()[1]
        self.url = f"http://{_HOST}:{self._port}/"
        self._clients: set[_Poses] = set()
        self._last = b""
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, args=(sockets, page), daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        return f"<Viewer of {', '.join(self.names)} at {self.url}>"

    def show(
        self,
        *configurations: ArrayLike,
        before: Sequence[ArrayLike] | Array | None = None,
        out_of_reach: bool = False,
        target: ArrayLike | None = None,
        cycles: int = 0,
    ) -> None:
        """Send a configuration (n,) per controller, in the order of ``names``, and return at once.

        Parameters
        ----------
        configurations
            Current configuration of each controller.
        before
            Configurations, one per controller, with which the current ones are compared; shown as
            grey outlines. By default, those of the first call.
        out_of_reach
            True to show on the page that the target is out of reach.
        target : (3,) array, optional
            Target of the frame, m, base axes, which is drawn, and can be dragged.
        cycles
            Number of completed cycles.

        Raises
        ------
        InputError
            If there is not one configuration per controller, or one has the wrong size.
        """
        now = self._each(configurations, "configurations")
        self._first = now if self._first is None else self._first
        then = self._first if before is None else self._each(before, "before")
        drift = np.linalg.norm(now - then, axis=1)  # (K,)
        past = self.task.limit_margin(now).min(axis=1) < -1e-9
        both = np.vstack([now, then])
        placements = self._placements(both)[:, self._moving]
        goal = np.full(3, np.nan) if target is None else vector(target, 3, "target")
        elbows = [self.task.joint_origins(q)[self._elbow] for q in now]
        numbers = [
            *(poses_of(placements).ravel(), drift, past, [flag(out_of_reach, "out_of_reach")]),
            *(goal, [as_int(cycles, "cycles", 0)]),
            *(self.task.positions(both).ravel(), np.ravel(elbows)),
        ]
        self._last = np.concatenate(numbers).astype("<f4").tobytes()
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._send)

    def _placements(self, Q: Array) -> Array:
        """Compute the placements of S shapes at T configurations Q (T, n): (T, S, 4, 4), m.

        They are relative to the link ``task.robot.base``, which other joints can move, or relative
        to the root link if ``task.robot.base`` is None.
        """
        rows = self.task.to_robot(Q)
        placements = self._visuals.placements(rows)
        if self.task.robot.base is None:
            return placements
        base = base_placements(self.task.robot, rows)
        return np.asarray(np.linalg.inv(base)[:, None] @ placements)

    def _each(self, configurations: Sequence[ArrayLike] | Array, name: str) -> Array:
        """Check that there is one configuration per controller; return an array with one row each.

        InputError is raised if the number of configurations, or the size of one, is wrong.
        """
        if isinstance(configurations, np.ndarray) and configurations.ndim == 2:
            configurations = list(configurations)
        configurations = list_of(
            configurations, name, "a list of configurations, one per controller"
        )
        if len(configurations) != len(self.names):
            raise InputError(
                f"this viewer shows {len(self.names)} controllers, "
                f"but {len(configurations)} configurations were given; give one per controller"
            )
        return np.array([vector(q, self.task.n, "q") for q in configurations])

    def open(self) -> bool:
        """Open the page in the browser; return False if there is no screen or no browser."""
        screen = (
            sys.platform in ("darwin", "win32")
            or os.environ.get("DISPLAY")
            or os.environ.get("WAYLAND_DISPLAY")
        )
        return bool(screen) and webbrowser.open(self.url)

    def close(self) -> None:
        """Stop the server and release its port."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.close()

    def _page(self, q0: Array, path: TaskPath | None) -> str:
        """Make the HTML page of the viewer, and set ``_moving``: the mask (S,) of moving shapes.

        A shape moves if its placement differs between the start q0 (n,) and two configurations that
        are shifted by ±0.3 rad or m in each joint, within its limits. Only placements of moving
        shapes are sent. ``path`` is the path to draw, if any.
        """
        task = self.task
        # which bodies move: those that differ between three configurations
        Q = np.array(
            [
                q0,
                np.clip(q0 + 0.3, task.lower, task.upper),
                np.clip(q0 - 0.3, task.lower, task.upper),
            ]
        )
        shapes = self._visuals.shapes
        placements = self._placements(Q)
        self._moving = moving_of(placements)
        surfaces = read_surfaces(shapes)
        frames = Frames(np.arange(3), (1,), 3)
        # the part that the page points at, and the frame
        outer, off = body_drift(self._visuals.corners(surfaces), placements, frames.per_cycle)
        link, _ = farthest(shapes, off[-1], arm_links(task))
        points = task.positions(Q)
        tips = points[:, None]
        colours = (VERMILLION, BLUE, GREEN, PURPLE) * len(self.names)
        # one arm per pane, all at the start
        arms = [
            Arm(
                name,
                shapes,
                placements,
                tips,
                tips,
                np.zeros(1),
                outer,
                off,
                color=colour,
                unit=task.unit,
            )
            for name, colour in zip(self.names, colours, strict=False)
        ]
        caption = f"{task.frame}: {task.kind.words}"
        lines = [] if path is None else [path.points()]
        flat = is_planar(np.vstack([*map(task.joint_origins, Q), points, *lines]))
        return animation_page(
            arms,
            lines,
            frames=frames,
            surfaces=surfaces,
            seconds=1.0,
            title=f"{task.robot.name}: live",
            caption=caption,
            part=(link, link),
            planar=flat,
            live=True,
            names={s.name: part_name(task, q0, s.link) for s in shapes},
        )

    def _serve(self, sockets: Any, page: str) -> None:
        """Run the server until its loop is stopped, then close it.

        This is the function of the viewer's thread. ``sockets`` are the open sockets of the port,
        and ``page`` is the HTML page to serve.
        """
        asyncio.set_event_loop(self._loop)
        handlers: list[Any] = [("/", _Page, {"page": page}), ("/poses", _Poses, {"viewer": self})]
        server = HTTPServer(Application(handlers, websocket_max_message_size=_MESSAGE))
        self._loop.call_soon(server.add_sockets, sockets)
        self._loop.run_forever()
        server.stop()
        for client in tuple(self._clients):
            client.close()
        self._loop.run_until_complete(server.close_all_connections())
        self._loop.close()

    def _send(self) -> None:
        """Send the newest poses to every browser that shows the page."""
        for client in tuple(self._clients):
            client.give(self._last)

    def _moved(self, message: str) -> None:
        """Move the target by a message of the page, in JSON.

        The message is a displacement [x, y, z], m, or "home". The displacement is added to
        ``offset``, and "home" resets ``offset`` to 0. A displacement with a component beyond
        ±0.1 m, or an invalid message, is ignored. Each component of ``offset`` is limited to the
        arm's length.
        """
        try:
            move = json.loads(message)
        except ValueError:
            return
        if move == "home":
            self.offset = np.zeros(3)
        elif (
            isinstance(move, list)
            and len(move) == 3
            and all(isinstance(v, int | float) and abs(v) <= 0.1 for v in move)
        ):
            self.offset = np.clip(self.offset + move, -self._reach, self._reach)


def _only_this_host(request: RequestHandler) -> None:
    """Refuse, with status 403, a request whose header Host is not 127.0.0.1 or localhost.

    Otherwise a web site could let its own host name resolve to 127.0.0.1 (DNS rebinding), and its
    pages could read the configurations.
    """
    if request.request.host_name not in (_HOST, "localhost"):
        request.send_error(403)


class _Page(RequestHandler):
    """Request handler that serves the page."""

    prepare = _only_this_host

    def initialize(self, page: str) -> None:
        self.page = page

    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.finish(self.page)


class _Poses(WebSocketHandler):
    """Websocket that sends poses to one browser, and receives moves of the target from it."""

    prepare = _only_this_host

    def initialize(self, viewer: Viewer) -> None:
        self.viewer = viewer
        self.busy = False
        self.sent = b""

    def check_origin(self, origin: str) -> bool:
        return origin in (f"http://{name}:{self.viewer._port}" for name in (_HOST, "localhost"))

    def open(self, *args: str, **kwargs: str) -> None:
        self.viewer._clients.add(self)
        if self.viewer._last:
            self.give(self.viewer._last)

    def on_close(self) -> None:
        self.viewer._clients.discard(self)

    def on_message(self, message: str | bytes) -> None:
        if isinstance(message, str):
            self.viewer._moved(message)

    def give(self, poses: bytes) -> None:
        """Send encoded poses of the shapes, unless an earlier message is being sent.

        When that message has been sent, the newest poses follow: a slow browser misses some poses,
        but always receives the last ones.
        """
        if self.busy or poses is self.sent:
            return
        try:
            given = asyncio.ensure_future(self.write_message(poses, binary=True))
        except WebSocketClosedError:
            self.on_close()
            return
        self.busy, self.sent = True, poses
        given.add_done_callback(self._given)

    def _given(self, given: asyncio.Future[None]) -> None:
        self.busy = False
        if given.cancelled() or given.exception():  # the browser has gone
            self.on_close()
        else:
            self.give(self.viewer._last)  # what has been shown meanwhile
