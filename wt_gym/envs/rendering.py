"""Pictures for ``render()``: turbine and wake, and the recent course of the key signals.

matplotlib draws them. A live view is a window of its own; without a display it is a picture in a file, which is
written again at every step.
"""

import os
import tempfile
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from wt_gym.analysis.scene import Scene
from wt_gym.base.files import write_whole
from wt_gym.base.picture_style import BLUE, GRAY, INK, plain
from wt_gym.envs.operation import Operation
from wt_gym.envs.terms import Beginning, Term, Transition
from wt_gym.simulation import Signals
from wt_gym.turbines import Turbine

_WINDOW = 60.0
_RPM = 30 / np.pi


class Renderer(Term):
    """Draws an environment with its operation; live, at every reset and step."""

    def __init__(self, turbine: Turbine, operation: Operation, live: bool = False):
        self._history: deque[tuple[float, ...]] = deque()
        self._arguments = turbine, operation, live
        shape: dict[str, Any] = {"figsize": (9.6, 5.4), "dpi": 100, "facecolor": "white"}  # 960 by 540 pixels
        self._file: Path | None = None
        if live:
            from matplotlib import pyplot  # looks for a display

            self._figure = pyplot.figure(**shape)
            self._canvas: Any = cast("Any", self._figure.canvas)
            if self._canvas.required_interactive_framework is None:
                self._file = Path(tempfile.gettempdir()) / f"wt_gym_live_{os.getpid()}.png"
                gym.logger.warn(f"there is no display: the live picture is {self._file}")
            else:
                self._canvas.manager.show()
        else:
            self._figure = Figure(**shape)
            self._canvas = FigureCanvasAgg(self._figure)
        self._scene = Scene(self._figure.add_axes((0.0, 0.0, 0.62, 0.93)), turbine)
        self._label = self._figure.text(0.02, 0.965, "", color=INK, fontsize=11, va="top")
        self._build_strips(turbine)

    def __getstate__(self) -> tuple[Any, ...]:
        """Leave out the figure, which can be made again, but not be copied."""
        return self._arguments, self._history

    def __setstate__(self, kept: tuple[Any, ...]) -> None:
        """Make the figure and take over the course of the signals."""
        arguments, history = kept
        Renderer.__init__(self, *arguments)
        self._history.extend(history)

    def begin(self, _: Beginning) -> None:
        """Start with the first signals of an episode."""
        self._history.clear()
        self.record(self._arguments[1].signals)
        self._show()

    def follow(self, transition: Transition) -> None:
        """Take the signals after a step."""
        self.record(transition.after)
        self._show()

    def _show(self) -> None:
        """Bring a live view up to date."""
        _, operation, live = self._arguments
        if live and operation.simulator is not None:
            self.draw(operation.simulator.geometry())

    def close(self) -> None:
        """Close the window, or remove the file."""
        if self._arguments[2]:
            from matplotlib import pyplot

            pyplot.close(self._figure)
        if self._file is not None:
            self._file.unlink(missing_ok=True)

    def record(self, signals: Signals) -> None:
        """Take the signals of an instant."""
        row = (
            signals["time"], np.hypot(signals["wind_x"], signals["wind_y"]), signals["generator_power"] / 1e6,
            signals["rotor_speed"] * _RPM, np.degrees(signals["pitch_1"]), signals["tip_out_of_plane_1"],
        )  # fmt: skip
        self._history.append(row)
        while self._history[0][0] < row[0] - _WINDOW:
            self._history.popleft()

    def memory(self) -> dict[str, Any]:
        """Give the course of the signals, for `recall`."""
        return {"history": tuple(self._history)}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with a course of the signals; without one the current signals begin it."""
        self._history = deque(memory.get("history", ()))
        if not self._history:
            self.record(self._arguments[1].signals)

    def draw(self, geometry: Mapping[str, np.ndarray] | None) -> np.ndarray | None:
        """Draw the turbine and the recorded signals.

        Parameters
        ----------
        geometry : mapping or None
            As given by ``Simulator.geometry()``; None leaves the turbine as it was drawn last.

        Returns
        -------
        numpy.ndarray, uint8, shape (height, width, 3)
            None of a live view.
        """
        if geometry is not None:
            self._scene.draw(geometry)
        self._draw_strips()
        if self._file is not None:
            write_whole(self._file, lambda file: self._figure.savefig(file, format="png"))
            return None
        self._canvas.draw()
        if self._arguments[2]:
            self._canvas.flush_events()
            return None
        return np.array(self._canvas.buffer_rgba())[..., :3].copy()

    def _build_strips(self, turbine: Turbine) -> None:
        drivetrain = turbine.drivetrain
        rows = (
            ("Wind at the hub [m/s]", None),
            ("Electrical power [MW]", drivetrain.rated_power / 1e6),
            ("Rotor speed [rpm]", drivetrain.rated_rotor_speed * _RPM),
            ("Pitch of blade 1 [deg]", None),
            ("Tip deflection of blade 1 [m]", None),
        )
        self._strips = []
        for i, (title, limit) in enumerate(rows):
            axes = self._figure.add_axes((0.67, 0.835 - 0.19 * i, 0.31, 0.115))
            plain(axes)
            axes.set_title(title, loc="left", fontsize=9, color=INK, pad=3)
            axes.tick_params(labelbottom=i == len(rows) - 1)
            if limit is not None:
                axes.axhline(limit, color=GRAY, linewidth=0.8, linestyle="--")
                style: dict[str, Any] = {"ha": "right", "fontsize": 7, "color": GRAY, "transform": axes.transAxes}
                axes.text(1.0, 1.03, f"dashed: rated, {limit:.4g}", **style)
            (line,) = axes.plot([], [], color=BLUE, linewidth=1.2)
            self._strips.append((axes, line, limit))
        axes.set_xlabel("Time [s]", fontsize=8, color=INK, labelpad=1)

    def _draw_strips(self) -> None:
        table = np.array(self._history)
        if not len(table):
            return
        time = table[:, 0]
        self._label.set_text(f"{self._arguments[0].heading.partition(',')[0]}, {time[-1]:.1f} s")
        for (axes, line, limit), values in zip(self._strips, table[:, 1:].T, strict=True):
            line.set_data(time, values)
            shown = values if limit is None else np.append(values, limit)
            low, high = float(shown.min()), float(shown.max())
            margin = max(0.08 * (high - low), 0.02 * abs(high), 0.05)
            axes.set_xlim(max(time[0], time[-1] - _WINDOW), max(time[-1], time[0] + 1.0))
            axes.set_ylim(low - margin, high + margin)
