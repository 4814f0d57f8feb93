#!/usr/bin/env python3
"""The picture of axes, angles and signs on the page docs/frames.md.

    scripts/frames.py        # docs/data/frames.svg

Lengths, tilt and cone are those of the NREL 5-MW turbine; tilt, cone and pitch are drawn three times as large.
"""

import argparse
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

ROOT = Path(__file__).resolve().parents[1]
INK, AXIS, ANGLE, BODY = "#1c2733", "#0b6aa2", "#b3470b", "#c3ccd4"
EXAGGERATED = 3.0


def arrow(axes, start, end, label, color=AXIS, offset=(4, 4)):
    """Draw an arrow with a label at its head."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.6})
    axes.annotate(label, end, xytext=offset, textcoords="offset points", color=color, fontsize=9)


def arc(axes, center, radius, first, last, label, place, color=ANGLE):
    """Draw an arc with an arrow head from one angle to another [rad] and a label."""
    import numpy as np

    angle = np.linspace(first, last, 40)
    x, y = center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)
    axes.plot(x[:-1], y[:-1], color=color, linewidth=1.4)
    axes.annotate(
        "", (x[-1], y[-1]), (x[-3], y[-3]), arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.4}
    )
    axes.text(*place, label, color=color, fontsize=9)


def side(axes, turbine):
    """View from the right of the turbine: wind from the left."""
    import numpy as np

    hub, radius, base = turbine.hub_height, turbine.rotor_diameter / 2, 0.0
    tilt, cone = EXAGGERATED * turbine.nacelle.tilt, EXAGGERATED * turbine.hub.cone
    overhang = 3.0 * turbine.nacelle.overhang
    apex = np.array([-overhang * np.cos(tilt), hub + overhang * np.sin(tilt)])
    axes.plot([0, 0], [base, hub - 3], color=BODY, linewidth=8, solid_capstyle="butt", zorder=1)
    axes.plot([apex[0], 9], [apex[1], hub - 9 * np.tan(tilt)], color=INK, linewidth=5, zorder=2)
    for sense, label in ((1.0, "blade 1"), (-1.0, "")):
        along = np.array([sense * np.sin(tilt) - np.sin(cone), sense * np.cos(tilt)])
        tip = apex + radius * along / np.linalg.norm(along)
        axes.plot([apex[0], tip[0]], [apex[1], tip[1]], color=INK, linewidth=3)
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
        arrow(axes, (-95, height), (-70, height), "", color="#6b7f8f")
    axes.text(-95, 136, "wind", color="#6b7f8f", fontsize=9)
    arrow(axes, (9, hub + 8), (40, hub + 8), "fore-aft > 0", color=ANGLE, offset=(-36, 6))
    axes.set(xlim=(-105, 75), ylim=(-12, 168), title="from the right")


def front(axes, turbine):
    """View looking downwind: y to the left."""
    import numpy as np

    hub, radius = turbine.hub_height, turbine.rotor_diameter / 2
    axes.plot([0, 0], [0, hub], color=BODY, linewidth=8, solid_capstyle="butt", zorder=1)
    for b in range(turbine.n_blades):
        angle = np.radians(20.0) + 2 * np.pi * b / turbine.n_blades
        tip = radius * np.sin(angle), hub + radius * np.cos(angle)
        axes.plot([0, tip[0]], [hub, tip[1]], color=INK, linewidth=3)
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
    import numpy as np

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
    arrow(axes, (-0.95, 0.0), (-0.55, 0.0), "wind", color="#6b7f8f", offset=(-26, 5))
    arrow(axes, (0.75, 0.6), (0.75, 0.15), "rotation", color="#6b7f8f", offset=(-22, -12))
    axes.set(xlim=(-1.05, 1.05), ylim=(-0.9, 1.0), title="section of an upright blade, from the tip")


def main(words=None):
    """Draw and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--out", type=Path, default=ROOT / "docs" / "data" / "frames.svg", help="(default: %(default)s)"
    )
    arguments = parser.parse_args(words)
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams |= {"svg.hashsalt": "frames", "svg.fonttype": "path"}
    import matplotlib.pyplot as plt

    from wt_gym.turbines import load_turbine

    turbine = load_turbine("nrel_5mw")
    figure, axes = plt.subplots(1, 3, figsize=(11.5, 4.3), layout="constrained")
    side(axes[0], turbine)
    front(axes[1], turbine)
    section(axes[2])
    for place in axes:
        place.set_aspect("equal")
        place.axis("off")
    figure.savefig(arguments.out, metadata={"Date": None})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
