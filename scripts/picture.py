#!/usr/bin/env python3
"""The animation of README and site: the published controller and the best trained agent side by side in one wind.

    scripts/picture.py                       # docs/data/turbine.gif
    scripts/picture.py --frames 120 --out runs/longer.gif

Shapes are to scale, from the simulation itself at fidelity `engineering`. The wind is light turbulence on a sheared
profile, the same for both. One frame a control step; below the scenes is the flap moment of blade 1.
"""

import argparse
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

ROOT = Path(__file__).resolve().parents[1]
AGENT = ROOT / "agents" / "trained" / "load_reduction_on_linear_optimal"
WIDTH, HEIGHT, DPI = 840, 480, 100
SHEAR, LIGHT = 0.2, 0.35  # exponent of the profile; turbulence as a share of that of class B
NEARLY_WHITE = 247  # of 255
FRAME_TIME = 80  # of the animation [ms]
BEFORE = 10.0  # part of the run before the first frame that the flap moment is shown for [s]
LABELS = {"controller": "Published controller", "agent": "Trained agent"}


def parse_arguments(words=None):
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--out", type=Path, default=ROOT / "docs" / "data" / "turbine.gif", help="(default: %(default)s)"
    )
    parser.add_argument("--frames", type=int, default=50, help="of 0.1 s; 50 are a turn (default: %(default)s)")
    parser.add_argument("--wind-speed", type=float, default=13.0, help="mean at the hub [m/s] (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1001, help="of the turbulence (default: %(default)s)")
    parser.add_argument("--start", type=float, default=55.0, help="time of the first frame [s] (default: %(default)s)")
    parser.add_argument("--colors", type=int, default=48, help="of the picture (default: %(default)s)")
    parser.add_argument("--last-frame", type=Path, help="write the last frame as a PNG as well")
    arguments = parser.parse_args(words)
    if arguments.frames < 1 or not 3 <= arguments.colors <= 256 or arguments.start < 0.0:
        parser.error("at least one frame, 3 to 256 colors and a start at 0 s or later are needed")
    return arguments


def wind(turbine, speed, seed):
    """Light turbulence on a sheared profile, and its intensity at the hub."""
    from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow
    from wt_gym.wind.iec import turbulence_sigma

    box = TurbulenceBox.kaimal(speed, turbine.hub_height, turbine.rotor_diameter, "B", seed=seed)
    steady = SteadyInflow(speed, turbine.hub_height, shear_exponent=SHEAR)
    return TurbulentInflow(box.carried_along(speed, LIGHT, "light turbulence"), steady), LIGHT * turbulence_sigma(
        speed, "B"
    ) / speed


def simulate(inflow, start, n_frames, trained):
    """Shapes of the frames, and rows of time and flap moment, under the agent or the base controller."""
    import gymnasium as gym
    import numpy as np

    import wt_gym  # noqa: F401 - registers the environments
    from wt_gym.experiment.trained_agent import TrainedAgent, read_record

    arguments, agent = {}, None
    if trained:
        agent = TrainedAgent.load(AGENT)
        chosen = read_record(AGENT / "training.json")["config"]["env_kwargs"]
        arguments = {name: value for name, value in chosen.items() if name != "wind_speed"}
    env = gym.make("wt_gym/LoadReduction-v2", fidelity="engineering", inflow=inflow, **arguments)
    observation, info = env.reset(seed=0, options={"azimuth": 0.0})
    rest = np.zeros(env.action_space.shape, dtype=np.float32)
    rows, shapes = [], []
    while len(shapes) < n_frames:
        action = rest if agent is None else agent.predict(observation)[0]
        observation, _, terminated, _, info = env.step(action)
        if terminated:
            raise SystemExit(f"error: the episode ended at {info['time']:.1f} s: {info['termination']}")
        signals = env.unwrapped.signals
        rows.append((signals["time"], signals["root_flap_moment_1"] / 1e6))
        if info["time"] > start - 1e-6:
            shapes.append(env.unwrapped.simulator.geometry())
    return shapes, np.array(rows)


class Picture:
    """Two scenes above, the flap moment of both runs below.

    Parameters
    ----------
    turbine : Turbine
    runs : dict
        Keys of `LABELS` to shapes and rows as `simulate` returns them.
    text : str
        About the wind.
    """

    def __init__(self, turbine, runs, text):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        from wt_gym.analysis.scene import Scene
        from wt_gym.base.picture_style import BLUE, INK, ORANGE, plain

        self._runs, self._colors = runs, dict(zip(LABELS, (ORANGE, BLUE), strict=True))
        self._figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        self._scenes = {}
        for k, (name, label) in enumerate(LABELS.items()):
            axes = self._figure.add_axes((0.5 * k, 0.31, 0.5, 0.64))
            self._scenes[name] = Scene(axes, turbine, length=1.6, color=self._colors[name])
            self._figure.text(
                0.5 * k + 0.02, 0.965, label, fontsize=12, weight="bold", color=self._colors[name], va="top"
            )
        self._clock = self._figure.text(0.98, 0.965, "", fontsize=10, color=INK, ha="right", va="top")
        self._figure.text(0.98, 0.275, text, fontsize=8.5, color=INK, ha="right", va="bottom")
        axes = self._figure.add_axes((0.05, 0.095, 0.93, 0.17))
        plain(axes, "time [s]", title="Flap moment at the root of blade 1 [MN m]")
        self._lines = {}
        for name, (shapes, rows) in runs.items():
            shown = rows[rows[:, 0] >= rows[-len(shapes), 0] - BEFORE]
            first = len(shown) - len(shapes)
            axes.plot(*shown.T, color=self._colors[name], linewidth=1.0, alpha=0.3)
            line, dot = axes.plot([], [], color=self._colors[name], linewidth=2.0)[0], axes.plot(
                [], [], "o", color=self._colors[name], markersize=5, clip_on=False
            )[0]  # fmt: skip
            self._lines[name] = line, dot, shown, first
            axes.set_xlim(shown[0, 0], shown[-1, 0])

    def draw(self, k):
        """Picture of frame k as an array (HEIGHT, WIDTH, 3)."""
        import numpy as np

        for name, (shapes, _) in self._runs.items():
            self._scenes[name].draw(shapes[k])
            line, dot, shown, first = self._lines[name]
            line.set_data(*shown[: first + k + 1].T)
            dot.set_data(*shown[first + k : first + k + 1].T)
            self._clock.set_text(f"{shown[first + k, 0]:.1f} s")
        self._canvas.draw()
        return np.array(self._canvas.buffer_rgba())[..., :3].copy()


def save(frames, path, n_colors):
    """Write an animated GIF with one palette for all frames, so that what rests costs nothing."""
    from PIL import Image

    images = [Image.fromarray(frame) for frame in frames]
    sheet = Image.new("RGB", (WIDTH, HEIGHT * 3), "white")
    for row, image in enumerate((images[0], images[len(images) // 2], images[-1])):
        sheet.paste(image, (0, HEIGHT * row))
    palette = sheet.quantize(n_colors, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    # averages with what is nearly white are white
    colors = palette.getpalette()[: 3 * n_colors]
    for k in range(0, len(colors), 3):
        if min(colors[k : k + 3]) >= NEARLY_WHITE:
            colors[k : k + 3] = [255, 255, 255]
    palette.putpalette(colors)
    images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    path.parent.mkdir(parents=True, exist_ok=True)
    images[0].save(path, save_all=True, append_images=images[1:], duration=FRAME_TIME, loop=0, disposal=1)


def main(words=None):
    """Simulate, draw, write."""
    from PIL import Image

    from wt_gym.turbines import load_turbine

    arguments = parse_arguments(words)
    turbine = load_turbine("nrel_5mw")
    inflow, intensity = wind(turbine, arguments.wind_speed, arguments.seed)
    runs = {name: simulate(inflow, arguments.start, arguments.frames, name == "agent") for name in LABELS}
    text = f"both in the same wind: {arguments.wind_speed:g} m/s, turbulence {100 * intensity:.0f} %, shear {SHEAR}"
    picture = Picture(turbine, runs, text)
    frames = [picture.draw(k) for k in range(arguments.frames)]
    save(frames, arguments.out, arguments.colors)
    if arguments.last_frame:
        Image.fromarray(frames[-1]).save(arguments.last_frame)
    print(f"{arguments.out}: {len(frames)} frames, {arguments.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
