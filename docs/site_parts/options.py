"""Channels, turbines, controllers, fidelities and options of the lattice."""

from site_parts.markdown import meaning, table, value
from wt_gym.aerodynamics import AeroOptions
from wt_gym.base.options import options_of
from wt_gym.control.bladed import RECORDS
from wt_gym.control.controllers import (
    ADDITIONS,
    BASES,
    GUARDS,
    WRAPPERS,
    controller_parameters,
    controller_summary,
    declared_parameters,
)
from wt_gym.control.controllers.names import default_text
from wt_gym.simulation import FIDELITIES, Fidelity, channel_table
from wt_gym.simulation.channels import EVEN
from wt_gym.turbines import catalog, load_turbine

_RPM = 9.549296585513721


def records():
    """Records of the Bladed interface."""
    rows = [(", ".join(map(str, r.numbers)), r.unit, r.given_by, r.meaning) for r in RECORDS]
    return table(("record", "unit", "given by", "meaning"), rows, "channels")


def channels():
    """Signals of a turbine with three blades; those of the blades once."""
    rows, seen = [], set()
    for channel in channel_table(3):
        if channel.group in seen:
            continue
        seen.add(channel.group)
        of_blade = channel.name != channel.group
        name = f"`{channel.group}`" + (" `_1` `_2` `_3`" if of_blade else "")
        fast = f"`{channel.openfast}`" if channel.openfast else ""
        parity = "+" if channel.parity == EVEN else "−"
        rows.append((name, channel.unit, fast, parity, channel.description.removesuffix(", blade 1")))
    return table(("channel", "unit", "OpenFAST", "parity", "what"), rows, "channels")


def turbines():
    """The catalog."""
    rows = []
    for name in catalog():
        t = load_turbine(name)
        speed = t.drivetrain.rated_rotor_speed * _RPM
        sizes = (
            _power(t.drivetrain.rated_power), f"{t.rotor_diameter:.4g} m", f"{t.hub_height:.4g} m", f"{speed:.4g} rpm",
            f"{t.cut_in:g}–{t.cut_out:g} m/s",
        )  # fmt: skip
        rows.append((f"`{name}`", t.name, *(size.replace(" ", "\u00a0") for size in sizes)))
    headings = ("name", "turbine", "rated power", "rotor", "hub height", "rated speed", "wind")
    return table(headings, rows, "options")


def _power(watts):
    return f"{watts / 1e6:.3g} MW" if watts >= 1e5 else f"{watts:.3g} W"


def controllers():
    """Names for ``controller=`` and the command line, with their parameters."""
    rows = []
    kinds = {"base": BASES, "works inside a base": WRAPPERS, "addition": ADDITIONS, "around all parts": GUARDS}
    for kind, makers in kinds.items():
        for name in makers:
            parameters = ", ".join(f"`{key}`" for key in controller_parameters(name))
            rows.append((f"`{name}`", kind, controller_summary(name), parameters))
    return table(("name", "kind", "what it is", "parameters"), rows, "options")


def parameters():
    """Parameters of every controller; names that stand for several parts have those of the parts."""
    rows = []
    for name in (*BASES, *WRAPPERS, *ADDITIONS, *GUARDS):
        for parameter in declared_parameters(name):
            shown = default_text(parameter)
            default = shown if parameter.default is None else f"`{shown}`"
            facts = parameter.unit, default, parameter.allowed, parameter.meaning
            rows.append((f"`{name}`", f"`{parameter.name}`", *facts))
    return table(("controller", "parameter", "unit", "default", "allowed", "meaning"), rows, "options")


def fidelities():
    """Presets of the whole simulation."""
    return _presets(Fidelity, FIDELITIES, skip=("name", "aero"))


def lattices():
    """Presets of the air."""
    return _presets(AeroOptions, {name: preset.aero for name, preset in FIDELITIES.items()})


def _presets(cls, presets, skip=()):
    """Fields with their defaults and the presets' values where they differ, then what each means."""
    declared, rows = [one for one in options_of(cls) if one.name not in skip], []
    for one in declared:
        values = [getattr(preset, one.name) for preset in presets.values()]
        if any(v != one.default for v in values):
            rows.append((f"`{one.name}`", value(one.default), *("" if v == one.default else value(v) for v in values)))
    differing = table(("option", "default", *(f"`{name}`" for name in presets)), rows, "options")
    listed = [(f"`{one.name}`", one.kind, value(one.default), *meaning(one)) for one in declared]
    return f"{differing}\n{table(('option', 'type', 'default', 'unit', 'allowed', 'meaning'), listed, 'options')}"
