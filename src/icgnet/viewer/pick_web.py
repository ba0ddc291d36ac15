"""A planned pick in the browser: the arm, its hand, what it carries and what stands around, with a slider of time."""

import threading
import time
from pathlib import Path

import numpy as np
import viser

from icgnet.arm.motion import Motion, MovingPart
from icgnet.geometry.transforms import matrix_to_quaternion, transform_points
from icgnet.viewer.motion_scene import part_colour, support_height
from icgnet.viewer.palette import to_bytes
from icgnet.viewer.served import ServedPage, serve

FRAME_TIME = 0.04
"""While it plays, the page is told so often where everything is [s]."""
SPEEDS = ("0.1 x", "0.25 x", "0.5 x", "1 x", "2 x")
PLAY, PAUSE = "Play", "Pause"
VIEW_AZIMUTH, VIEW_ELEVATION = np.deg2rad(-50.0), np.deg2rad(24.0)
GRID = 2.0
"""Edge of the grid that stands for the support [m]."""


def open_pick_viewer(source: str | Path | Motion, port: int = 8080, host: str = "127.0.0.1") -> "PickViewer":
    """Starts a viewer of a pick and returns at once; the page is served until `stop` is called.

    Args:
        source: a motion, or the file that `Motion.write` wrote.
        port: of the web page; the next free one if it is taken.
        host: address to listen on; "0.0.0.0" lets other machines look.

    Raises:
        DataError: the file is not a saved motion.
    """
    motion = source if isinstance(source, Motion) else Motion.load(Path(source))
    return PickViewer(motion, serve(port, host))


class PickViewer(ServedPage):
    """A page on which a pick plays, in the world (z up).

    Attributes:
        server: of the page.
        motion: that is shown.
        parts: name of each part of the motion by its number -> its handle on the page; the support is a grid.
    """

    def __init__(self, motion: Motion, server: viser.ViserServer) -> None:
        super().__init__(server)
        self.motion = motion
        self._set_up_page()
        self.parts = {
            number: self._add(part, number) for number, part in enumerate(motion.parts) if part.kind != "support"
        }
        gui = server.gui
        gui.add_markdown(f"**pick of {motion.title}**, {motion.duration:.1f} s")
        self._time = gui.add_slider("Time [s]", min=0.0, max=round(motion.duration, 2), step=0.01, initial_value=0.0)
        self._button = gui.add_button(PLAY)
        self._speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1 x")
        self._repeat = gui.add_checkbox("Repeat", initial_value=True)
        self._caption = gui.add_markdown("")
        self._lock = threading.Lock()
        self._playing, self._closed = threading.Event(), threading.Event()
        self._time.on_update(lambda _: self._show())
        self._button.on_click(lambda _: self.pause() if self.is_playing else self.play())
        self._show()
        self._thread = threading.Thread(target=self._run, daemon=True, name="pick viewer")
        self._thread.start()

    @property
    def time(self) -> float:
        """What the slider says [s]."""
        return float(self._time.value)

    @property
    def is_playing(self) -> bool:
        """Whether time goes on by itself."""
        return self._playing.is_set()

    def show(self, time: float) -> None:
        """Moves slider and scene to a time [s]."""
        self._time.value = min(max(float(time), 0.0), self._time.max)

    def play(self) -> None:
        """Lets time go on; from the start if it is at the end."""
        if self.time >= self._time.max:
            self.show(0.0)
        self._button.label = PAUSE
        self._playing.set()

    def pause(self) -> None:
        """Stops time."""
        self._playing.clear()
        self._button.label = PLAY

    def stop(self) -> None:
        """See `ServedPage`."""
        self._closed.set()
        self._playing.set()  # wakes the thread up
        self._thread.join()
        super().stop()

    def _set_up_page(self) -> None:
        points = np.concatenate(
            [
                transform_points(pose, np.asarray(part.mesh.vertices, float))
                for part in self.motion.parts
                if part.kind not in ("support", "background")
                for pose in part.poses[:: max(1, len(part.poses) // 20)]
            ]
        )
        middle = self.look_at(points, VIEW_AZIMUTH, VIEW_ELEVATION, (3, 4))
        self.server.scene.add_grid(
            "/support",
            width=GRID,
            height=GRID,
            cell_size=0.1,
            section_size=0.5,
            cell_color=(226, 228, 232),
            section_color=(206, 209, 214),
            position=(float(middle[0]), float(middle[1]), support_height(self.motion)),
        )

    def _add(self, part: MovingPart, number: int) -> viser.MeshHandle:
        return self.server.scene.add_mesh_simple(
            f"/parts/{number} {part.name}",
            np.asarray(part.mesh.vertices, np.float32),
            np.asarray(part.mesh.faces),
            color=to_bytes(part_colour(part)),
            flat_shading=True,
            side="double",
            wxyz=matrix_to_quaternion(part.poses[0, :3, :3]),
            position=part.poses[0, :3, 3],
        )

    def _show(self) -> None:
        """Puts everything where it is at the time that the slider says."""
        with self._lock, self.server.atomic():
            moment = self.motion.moment(self.time)
            for number, handle in self.parts.items():
                part = self.motion.parts[number]
                if not part.moves:
                    continue
                pose = part.at(moment)
                handle.visible = pose is not None
                if pose is not None:
                    handle.position, handle.wxyz = pose[:3, 3], matrix_to_quaternion(pose[:3, :3])
            self._caption.content = self.motion.caption(self.time)

    def _run(self) -> None:
        """Lets time go on while it plays, until the page is closed."""
        before = time.monotonic()
        while not self._closed.is_set():
            if not self.is_playing:
                self._playing.wait()
                before = time.monotonic()
                continue
            time.sleep(FRAME_TIME)
            now = time.monotonic()
            self._go_on(now - before)
            before = now

    def _go_on(self, seconds: float) -> None:
        """Moves on by a time of the wall clock [s]; from the end to the start, or stops there."""
        later = self.time + seconds * float(self._speed.value.split()[0])
        if later < self._time.max:
            self.show(later)
        elif self._repeat.value:
            self.show(0.0)
        else:
            self.show(self._time.max)
            self.pause()
