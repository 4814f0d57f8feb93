"""Pictures of the pages: the animation of the first page, axes and signs, and the tasks.

    python scripts/studies/pictures.py turbine            # docs/data/turbine.gif
    python scripts/studies/pictures.py turbine --frames 120 --out runs/longer.gif
    python scripts/studies/pictures.py frames             # docs/data/frames.svg, for docs/frames.md
    python scripts/studies/pictures.py tasks              # docs/data/task_NAME.png, for docs/tasks/index.md
    python scripts/studies/pictures.py tasks Yaw Gusts    # those of some

The animation shows the published controller and the best trained agent side by side in one wind, light turbulence on a
sheared profile. Shapes are to scale, from the simulation itself at fidelity `engineering`. One frame a control step;
below the scenes is the flap moment of blade 1. Lengths, tilt and cone of the axes are those of the NREL 5-MW turbine;
tilt, cone and pitch are drawn three times as large. Each task is shown under its base controller.
"""

import argparse
from pathlib import Path

import gymnasium as gym
import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from study_pages import DATA, TRAINED

from wt_gym.analysis.scene import Scene
from wt_gym.base.picture_style import BLUE, INK, ORANGE, plain
from wt_gym.experiment.trained_agent import TrainedAgent, read_record
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow
from wt_gym.wind.iec import turbulence_sigma

AGENT = TRAINED / "load_reduction"
WIDTH, HEIGHT, DPI = 840, 480, 100
SHEAR, LIGHT = 0.2, 0.35  # exponent of the profile; turbulence as a share of that of class B
NEARLY_WHITE = 247  # of 255
FRAME_TIME = 80  # of the animation [ms]
BEFORE = 10.0  # part of the run before the first frame that the flap moment is shown for [s]
LABELS = {"controller": "Published controller", "agent": "Trained agent"}


def simulate(inflow, start, n_frames, trained):
    """Shapes of the frames, and rows of time and flap moment, under the agent or the base controller."""
    arguments, agent = {}, None
    if trained:
        agent = TrainedAgent.load(AGENT)
        chosen = read_record(AGENT / "training.json")["config"]["env_kwargs"]
        arguments = {name: value for name, value in chosen.items() if name != "wind_speed"}
    env = gym.make("wt_gym/LoadReduction-v3", fidelity="engineering", inflow=inflow, **arguments)
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

    ``runs`` maps the keys of `LABELS` to shapes and rows as `simulate` returns them, ``text`` is about the wind.
    """

    def __init__(self, turbine, runs, text):
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
            (line,) = axes.plot([], [], color=self._colors[name], linewidth=2.0)
            (dot,) = axes.plot([], [], "o", color=self._colors[name], markersize=5, clip_on=False)
            self._lines[name] = line, dot, shown, first
            axes.set_xlim(shown[0, 0], shown[-1, 0])

    def draw(self, k):
        """Picture of frame k as an array (HEIGHT, WIDTH, 3)."""
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
    images = [Image.fromarray(frame) for frame in frames]
    sheet = Image.fromarray(np.concatenate([frames[0], frames[len(frames) // 2], frames[-1]]))
    palette = sheet.quantize(n_colors, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    # averages with what is nearly white are white
    colors = np.reshape(palette.getpalette()[: 3 * n_colors], (-1, 3))
    colors[colors.min(axis=1) >= NEARLY_WHITE] = 255
    palette.putpalette(colors.ravel().tolist())
    images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    path.parent.mkdir(parents=True, exist_ok=True)
    images[0].save(path, save_all=True, append_images=images[1:], duration=FRAME_TIME, loop=0, disposal=1)


def draw_turbine(arguments):
    """Simulate, draw and write the animation."""
    turbine, speed = load_turbine("nrel_5mw"), arguments.wind_speed
    box = TurbulenceBox.kaimal(speed, turbine.hub_height, turbine.rotor_diameter, "B", seed=arguments.seed)
    steady = SteadyInflow(speed, turbine.hub_height, shear_exponent=SHEAR)
    inflow = TurbulentInflow(box.carried_along(speed, LIGHT, "light turbulence"), steady)
    runs = {name: simulate(inflow, arguments.start, arguments.frames, name == "agent") for name in LABELS}
    intensity = 100 * LIGHT * turbulence_sigma(speed, "B") / speed
    picture = Picture(
        turbine, runs, f"both in the same wind: {speed:g} m/s, turbulence {intensity:.0f} %, shear {SHEAR}"
    )
    frames = [picture.draw(k) for k in range(arguments.frames)]
    save(frames, arguments.out, arguments.colors)
    print(f"{arguments.out}: {len(frames)} frames, {arguments.out.stat().st_size / 1e6:.2f} MB")


# ---- axes, angles and signs ----

AXIS, ANGLE, BODY = "#0b6aa2", "#b3470b", "#c3ccd4"
FRAME_INK, WIND = "#1c2733", "#6b7f8f"
EXAGGERATED = 3.0


def arrow(axes, start, end, label, color=AXIS, offset=(4, 4)):
    """Draw an arrow with a label at its head."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.6})
    axes.annotate(label, end, xytext=offset, textcoords="offset points", color=color, fontsize=9)


def arc(axes, center, radius, first, last, label, place, color=ANGLE):
    """Draw an arc with an arrow head from one angle to another [rad] and a label."""
    angle = np.linspace(first, last, 40)
    x, y = center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)
    axes.plot(x[:-1], y[:-1], color=color, linewidth=1.4)
    axes.annotate(
        "", (x[-1], y[-1]), (x[-3], y[-3]), arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.4}
    )
    axes.text(*place, label, color=color, fontsize=9)


def side(axes, turbine):
    """View from the right of the turbine: wind from the left."""
    hub, radius, base = turbine.hub_height, turbine.rotor_diameter / 2, 0.0
    tilt, cone = EXAGGERATED * turbine.nacelle.tilt, EXAGGERATED * turbine.hub.cone
    overhang = 3.0 * turbine.nacelle.overhang
    apex = np.array([-overhang * np.cos(tilt), hub + overhang * np.sin(tilt)])
    axes.plot([0, 0], [base, hub - 3], color=BODY, linewidth=8, solid_capstyle="butt", zorder=1)
    axes.plot([apex[0], 9], [apex[1], hub - 9 * np.tan(tilt)], color=FRAME_INK, linewidth=5, zorder=2)
    for sense, label in ((1.0, "blade 1"), (-1.0, "")):
        along = np.array([sense * np.sin(tilt) - np.sin(cone), sense * np.cos(tilt)])
        tip = apex + radius * along / np.linalg.norm(along)
        axes.plot([apex[0], tip[0]], [apex[1], tip[1]], color=FRAME_INK, linewidth=3)
        if label:
            axes.annotate(label, tip, xytext=(6, -4), textcoords="offset points", fontsize=9)
            arrow(axes, apex, apex + 0.45 * (tip - apex), "z", offset=(5, 0))
    axes.plot([apex[0] - 30, apex[0]], [hub + overhang * np.sin(tilt)] * 2, color=ANGLE, linewidth=0.8, linestyle=":")
    axes.plot([apex[0] - 30, apex[0]], [apex[1] + 30 * np.tan(tilt), apex[1]], color=ANGLE, linewidth=0.8)
    axes.text(apex[0] - 40, apex[1] + 13, "tilt > 0", color=ANGLE, fontsize=9)
    axes.text(apex[0] - 44, apex[1] + 45, "cone > 0\n(tips upwind)", color=ANGLE, fontsize=9)
    arrow(axes, (0, 0), (32, 0), "x downwind")
    arrow(axes, (0, 0), (0, 34), "z up", offset=(6, -2))
    for height in (60, 95, 130):
        arrow(axes, (-95, height), (-70, height), "", color=WIND)
    axes.text(-95, 136, "wind", color=WIND, fontsize=9)
    arrow(axes, (9, hub + 8), (40, hub + 8), "fore-aft > 0", color=ANGLE, offset=(-36, 6))
    axes.set(xlim=(-105, 75), ylim=(-12, 168), title="from the right")


def front(axes, turbine):
    """View looking downwind: y to the left."""
    hub, radius = turbine.hub_height, turbine.rotor_diameter / 2
    axes.plot([0, 0], [0, hub], color=BODY, linewidth=8, solid_capstyle="butt", zorder=1)
    for b in range(turbine.n_blades):
        angle = np.radians(20.0) + 2 * np.pi * b / turbine.n_blades
        tip = radius * np.sin(angle), hub + radius * np.cos(angle)
        axes.plot([0, tip[0]], [hub, tip[1]], color=FRAME_INK, linewidth=3)
        axes.annotate(f"{b + 1}", tip, xytext=(4, 2), textcoords="offset points", fontsize=9)
    axes.plot([0, 0], [hub, hub + radius], color=ANGLE, linewidth=0.8, linestyle=":")
    arc(axes, (0, hub), 0.75 * radius, np.pi / 2, np.pi / 2 - np.radians(20.0), "ψ", (5, hub + 0.84 * radius))
    arc(axes, (0, hub), 0.3 * radius, np.radians(200), np.radians(70), "Ω", (-26, hub + 12))
    arrow(axes, (0, 0), (-34, 0), "y left", offset=(-20, 6))
    arrow(axes, (0, 0), (0, 34), "z up", offset=(6, -2))
    arrow(axes, (0, hub - 22), (-38, hub - 22), "side-side > 0", color=ANGLE, offset=(-30, -12))
    axes.text(-74, hub + 0.9 * radius, "tilt acts here", color=ANGLE, fontsize=9)
    axes.text(0.62 * radius, hub - 12, "yaw acts here", color=ANGLE, fontsize=9)
    axes.set(xlim=(-90, 90), ylim=(-12, 168), title="looking downwind")


def section(axes):
    """Section of a blade that points up, seen from its tip: wind from the left, y of the global frame upwards."""
    t = np.linspace(0.0, 1.0, 80)
    half = 0.6 * (0.2969 * np.sqrt(t) - 0.126 * t - 0.3516 * t**2 + 0.2843 * t**3 - 0.1015 * t**4)
    pitch = EXAGGERATED * np.radians(8.0)
    leading = np.array([[-np.sin(pitch)], [-np.cos(pitch)]])  # in the rotor plane at zero pitch
    suction = np.array([[np.cos(pitch)], [-np.sin(pitch)]])
    upper, lower = (0.3 - t) * leading + half * suction, (0.3 - t) * leading - 0.6 * half * suction
    axes.fill(*np.concatenate([upper, lower[:, ::-1]], axis=1), color=BODY)
    axes.plot([0, 0], [-0.6, 0.95], color=ANGLE, linewidth=0.8, linestyle=":")
    axes.text(-0.04, 0.85, "rotor plane", color=ANGLE, fontsize=9, ha="right")
    arrow(axes, (0, 0), 0.5 * suction.ravel(), "x suction side", offset=(2, -12))
    arrow(axes, (0, 0), -0.85 * leading.ravel(), "y trailing edge", offset=(6, -4))
    arc(axes, (0, 0), 0.5, -np.pi / 2, -np.pi / 2 - pitch, "θ > 0\nto feather", (-0.75, -0.55))
    arrow(axes, (-0.95, 0.0), (-0.55, 0.0), "wind", color=WIND, offset=(-26, 5))
    arrow(axes, (0.75, 0.6), (0.75, 0.15), "rotation", color=WIND, offset=(-22, -12))
    axes.set(xlim=(-1.05, 1.05), ylim=(-0.9, 1.0), title="section of an upright blade, from the tip")


def draw_frames(arguments):
    """Draw and write axes, angles and signs."""
    turbine = load_turbine("nrel_5mw")
    figure = Figure(figsize=(11.5, 4.3), layout="constrained")
    axes = figure.subplots(1, 3)
    side(axes[0], turbine)
    front(axes[1], turbine)
    section(axes[2])
    for place in axes:
        place.set_aspect("equal")
        place.axis("off")
    with mpl.rc_context({"svg.hashsalt": "frames", "svg.fonttype": "path"}):
        figure.savefig(arguments.out, metadata={"Date": None})


# ---- tasks ----

SECONDS, TASK_WIDTH, TASK_COLORS = 20.0, 640, 48


def task_picture(task):
    """What `render` shows after some seconds of zero actions, as an image of few colors."""
    env = gym.make(task.id, render_mode="rgb_array", start="steady")
    env.reset(seed=0)
    rest = np.zeros(env.action_space.shape, dtype=np.float32)
    for _ in range(round(SECONDS / env.unwrapped.control_dt)):
        env.step(rest)
    image = Image.fromarray(env.render())
    image = image.resize((TASK_WIDTH, round(image.height * TASK_WIDTH / image.width)), Image.Resampling.LANCZOS)
    return image.quantize(TASK_COLORS)


def draw_tasks(arguments):
    """Render and write the tasks."""
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.tasks or TASKS:
        path = arguments.out / f"task_{name}.png"
        task_picture(TASKS[name]).save(path, optimize=True)
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB", flush=True)


def parse_arguments(words=None):
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    turbine, frames, tasks = (commands.add_parser(name) for name in ("turbine", "frames", "tasks"))
    turbine.add_argument("--frames", type=int, default=50, help="of 0.1 s; 50 are a turn (default: %(default)s)")
    turbine.add_argument("--wind-speed", type=float, default=13.0, help="mean at the hub, m/s (default: %(default)s)")
    turbine.add_argument("--seed", type=int, default=1001, help="of the turbulence (default: %(default)s)")
    turbine.add_argument("--start", type=float, default=55.0, help="time of the first frame, s (default: %(default)s)")
    turbine.add_argument("--colors", type=int, default=48, help="3 to 256 (default: %(default)s)")
    tasks.add_argument("tasks", nargs="*", metavar="TASK", choices=[*TASKS, []], help="(default: all)")
    for command, name in ((turbine, "turbine.gif"), (frames, "frames.svg"), (tasks, "")):
        command.add_argument("--out", type=Path, default=DATA / name, help="(default: %(default)s)")
    return parser.parse_args(words)


if __name__ == "__main__":
    arguments = parse_arguments()
    {"turbine": draw_turbine, "frames": draw_frames, "tasks": draw_tasks}[arguments.command](arguments)
