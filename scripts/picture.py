#!/usr/bin/env python3
"""The moving picture of README and site: rotor and wake in turbulent wind, under the agent `load_reduction`.

    scripts/picture.py                       # docs/data/turbine.gif
    scripts/picture.py --frames 120 --out runs/longer.gif

Shapes are to scale, from the simulation itself. One frame a control step, ten frames a second: twice real time.
"""

import argparse
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

ROOT = Path(__file__).resolve().parents[1]
WIDTH, HEIGHT, DPI = 880, 440, 100
INK, STEEL, BLADES = "#1c2733", "#9aa7b3", ("#0b6aa2", "#d95f02", "#1b9e77")
WINDOW = 10.0  # of the strips [s]
PIECES, FAINTEST = 3, 0.22  # curves of a filament's segment; weakest filaments that are drawn, of the strongest


def parse_arguments(words=None):
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--out", type=Path, default=ROOT / "docs" / "data" / "turbine.gif", help="(default: %(default)s)"
    )
    parser.add_argument("--frames", type=int, default=50, help="of 0.2 s each; 50 are two turns (default: %(default)s)")
    parser.add_argument("--wind-speed", type=float, default=17.0, help="mean [m/s] (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1001, help="of the turbulence (default: %(default)s)")
    parser.add_argument("--start", type=float, default=40.0, help="time of the first frame [s] (default: %(default)s)")
    parser.add_argument("--colors", type=int, default=32, help="of the picture (default: %(default)s)")
    arguments = parser.parse_args(words)
    if arguments.frames < 1 or not 2 <= arguments.colors <= 256 or arguments.start < 0.0:
        parser.error("at least one frame, 2 to 256 colors and a start at 0 s or later are needed")
    return arguments


def simulate(wind_speed, seed, start, n_frames):
    """Shapes and signals of the frames; the signals from one window before the first on."""
    import gymnasium as gym

    import wt_gym  # noqa: F401 - registers the environments
    from wt_gym.agents.trained_agent import TrainedAgent

    env = gym.make(
        "wt_gym/LoadReduction-v1", fidelity="engineering", inflow="turbulent", wind_speed=wind_speed,
        wind_seeds=[seed], max_episode_steps=10**9,
    )  # fmt: skip
    agent = TrainedAgent.load(ROOT / "agents" / "trained" / "load_reduction")
    observation, info = env.reset(seed=0, options={"time_offset": 0.0, "azimuth": 0.0})
    rows, shapes = [], []
    while len(shapes) < n_frames:
        observation, _, terminated, _, info = env.step(agent.predict(observation)[0])
        if terminated:
            raise SystemExit(f"error: the episode ended at {info['time']:.1f} s: {info['termination']}")
        rows.append(env.unwrapped.signals)
        if info["time"] > start - 1e-6:
            shapes.append(env.unwrapped.simulator.geometry())
    return shapes, rows


def smooth(lines, strength):
    """Curves through the nodes of the wake's filaments, each segment in `PIECES`, with the strength of the segments."""
    import numpy as np
    from scipy.interpolate import CubicSpline

    rows = np.arange(len(lines))
    fine = np.linspace(0.0, rows[-1], PIECES * rows[-1] + 1)
    return CubicSpline(rows, lines)(fine), np.repeat(strength[: rows[-1]], PIECES, axis=0)


class Picture:
    """Scene at the left, the course of wind, pitch and deflection at the right."""

    def __init__(self, shapes, rows):
        import numpy as np
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.collections import LineCollection, PolyCollection
        from matplotlib.figure import Figure

        turn, rise = np.radians(62.0), np.radians(9.0)  # looking downwind from the right and a little from above
        self._right = np.array([np.sin(turn), -np.cos(turn), 0.0])
        self._up = np.array([-np.cos(turn) * np.sin(rise), -np.sin(turn) * np.sin(rise), np.cos(rise)])
        self._figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        self._scene = self._figure.add_axes((0.0, 0.0, 0.64, 1.0))
        self._scene.set_axis_off()
        self._scene.set_aspect("equal")
        height = shapes[0]["tower"][-1, 2]
        half = 0.5 * 0.64 * WIDTH / HEIGHT * (bottom_to_top := 1.95 * height)
        self._scene.set_xlim(-0.36 * 2 * half, 0.64 * 2 * half)
        self._scene.set_ylim(-0.09 * height, -0.09 * height + bottom_to_top)
        self._wake = LineCollection([], cmap="Blues", clim=(-0.15, 1.1))
        self._steel = PolyCollection([], facecolors=STEEL, edgecolors="none", zorder=2)
        self._blades = PolyCollection([], facecolors=BLADES, edgecolors="none", zorder=3)
        for collection in (self._wake, self._steel, self._blades):
            self._scene.add_collection(collection)
        self._strips(rows, np)

    def _strips(self, rows, np):
        time = np.array([signals["time"] for signals in rows])
        of_blades = {name: np.array([signals[name] for signals in rows]) for name in ("pitch", "tip_out_of_plane")}
        wind = np.array([np.hypot(signals["wind_x"], signals["wind_y"]) for signals in rows])
        courses = (
            ("wind at the hub [m/s]", wind[:, None], (INK,)),
            ("pitch of the blades [deg]", np.degrees(of_blades["pitch"]), BLADES),
            ("tip deflection [m]", of_blades["tip_out_of_plane"], BLADES),
        )
        self._time, self._axes, self._dots = time, [], []
        for k, (title, values, colors) in enumerate(courses):
            axes = self._figure.add_axes((0.685, 0.715 - 0.3 * k, 0.29, 0.19))
            axes.set_title(title, loc="left", fontsize=9, color=INK, pad=3)
            axes.tick_params(labelsize=8, colors=INK, length=2, labelbottom=False)
            axes.spines[["top", "right"]].set_visible(False)
            for column, color in zip(values.T, colors, strict=True):
                axes.plot(time, column, color=color, linewidth=1.2)
                self._dots.append((axes.plot([], [], "o", color=color, markersize=4, clip_on=False)[0], column))
            seen = values[time > time[-1] - WINDOW - 0.2 * len(time)]
            axes.set_ylim(seen.min() - 0.1 * np.ptp(seen), seen.max() + 0.1 * np.ptp(seen))
            self._axes.append(axes)

    def draw(self, shapes, k):
        """Picture of one instant, row k of the signals, as an array (HEIGHT, WIDTH, 3)."""
        import numpy as np

        from wt_gym.analysis.replay import trailing_strength

        lines, strength = smooth(self._project(shapes["wake"]), trailing_strength(shapes["wake_circulation"]))
        age = np.linspace(0.0, 1.0, len(strength))[:, None, None]
        shade = np.clip(strength / np.quantile(strength, 0.99), 0.0, 1.0) * np.clip(1.3 * (1.0 - age), 0.0, 1.0)
        segments, shade = np.stack([lines[:-1], lines[1:]], axis=-2).reshape(-1, 2, 2), shade.ravel()
        shown = shade > FAINTEST
        self._wake.set_segments(segments[shown])
        self._wake.set_array(shade[shown])
        self._wake.set_linewidths(0.3 + 1.7 * shade[shown])
        outlines = [np.concatenate([b[0], b[-1][::-1]]) for b in self._project(shapes["blades"])]
        self._blades.set_verts(outlines)
        axis, radius = self._project(shapes["tower"]), shapes["tower_radius"]
        sides = np.column_stack([radius, 0.0 * radius])
        nacelle = self._project(shapes["nacelle"])
        thick = np.array([0.0, 2.0])
        box = [nacelle[0] - thick, nacelle[0] + thick, nacelle[1] + 1.3 * thick, nacelle[1] - 1.3 * thick]
        self._steel.set_verts([np.concatenate([axis - sides, (axis + sides)[::-1]]), np.array(box)])
        for axes in self._axes:
            axes.set_xlim(self._time[k] - WINDOW, self._time[k])
        for dot, column in self._dots:
            dot.set_data([self._time[k]], [column[k]])
        self._canvas.draw()
        return np.array(self._canvas.buffer_rgba())[..., :3].copy()

    def _project(self, points):
        import numpy as np

        return np.stack([points @ self._right, points @ self._up], axis=-1)


def save(frames, path, n_colors):
    """Write an animated GIF of few colors, the same in all frames, so that what rests costs nothing."""
    from PIL import Image

    images = [Image.fromarray(frame) for frame in frames]
    sheet = Image.new("RGB", (WIDTH, HEIGHT * 3 + 40 * 5), "white")
    for row, image in enumerate((images[0], images[len(images) // 2], images[-1])):
        sheet.paste(image, (0, HEIGHT * row))
    for row, color in enumerate((*BLADES, STEEL, INK)):  # thin things that must keep their colors
        sheet.paste(color, (0, 3 * HEIGHT + 40 * row, WIDTH, 3 * HEIGHT + 40 * (row + 1)))
    palette = sheet.quantize(n_colors, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    path.parent.mkdir(parents=True, exist_ok=True)
    images[0].save(path, save_all=True, append_images=images[1:], duration=100, loop=0, optimize=False, disposal=1)


def main():
    """Simulate, draw, write."""
    arguments = parse_arguments()
    shapes, rows = simulate(arguments.wind_speed, arguments.seed, arguments.start, arguments.frames)
    picture, first = Picture(shapes, rows), len(rows) - len(shapes)
    frames = [picture.draw(shape, first + k) for k, shape in enumerate(shapes)]
    save(frames, arguments.out, arguments.colors)
    print(f"{arguments.out}: {len(frames)} frames, {arguments.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
