"""Linear models of a turbine: matrices with names, multi-blade coordinates, modes and time response."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment

from wt_gym.base.errors import SimulationError
from wt_gym.base.quantities import MOTIONS, Array, Integers
from wt_gym.hydrodynamics.loads import PlatformLoads
from wt_gym.hydrodynamics.platform import Platform
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.simulation.channels import Signals, channel_table, parities, state_parities
from wt_gym.turbines.variants import REFLECTION_6

_PARTS = ("collective", "cosine", "sine")
_GROUPS = "|".join(dict.fromkeys(c.name[:-2] for c in channel_table(3) if c.name.endswith("_3")))
_BLADE_STATE = re.compile(r"blade_(?P<blade>\d)_(?P<base>.+?)(?P<rate>_rate)?")
_BLADE_CHANNEL = re.compile(rf"(?P<base>{_GROUPS})_(?P<blade>\d)(?P<rate>_rate)?")


@dataclass(frozen=True)
class SteadyPoint:
    """A steady operating point."""

    wind_speed: float  #: At hub height [m/s]
    rotor_speed: float  #: [rad/s]
    pitch: Array  #: [rad]; array (n_blades,)
    yaw: float  #: Nacelle yaw [rad]
    generator_torque: float  #: High-speed shaft [N m]; negative when the generator must drive the rotor
    azimuth: Array  #: At which the model was evaluated [rad]; array (n_azimuths,)
    states: Array  #: Of the multibody system, then those of the radiation; array (n_azimuths, n_state)
    outputs: Array  #: Mean of all channels over the azimuths; array (n_channels,)
    residual: float
    """Largest remaining acceleration of the averaged equations, in accelerations of the rotor's points [m/s²]."""

    @property
    def signals(self) -> Signals:
        """Mean of the channels as :class:`Signals`."""
        return Signals(self.outputs, len(self.pitch))


@dataclass(frozen=True)
class WaveForces:
    """Forces of waves on a floater, the sum of Re amplitude e^{iωt}: the inputs "wave_force_surge", … of its models."""

    frequency: Array  #: ω [rad/s]; array (c,)
    amplitude: NDArray[np.complex128]  #: Along and about global axes at the origin [N, N m]; array (c, 6), complex

    @classmethod
    def of(cls, platform: Platform, sea: WaveComponents) -> "WaveForces":
        """Forces of the waves of a sea on a platform, without drag.

        Raises
        ------
        InflowError
            If a component is outside of the table of the excitation.
        """
        loads = PlatformLoads(platform, 1.0)
        loads.set_sea(sea)
        return cls(loads.arrays.wave_frequency, loads.wave_force)

    def inputs(self, time: ArrayLike) -> dict[str, Array]:
        """Inputs at times (n_t,) [s], as `LinearModel.response` takes them."""
        series = (np.exp(1j * np.multiply.outer(np.asarray(time, dtype=float), self.frequency)) @ self.amplitude).real
        return {f"wave_force_{motion}": series[:, k] for k, motion in enumerate(MOTIONS)}


class RotorPoint(Protocol):
    """Speed and pitch of a rotor, as an operating point has them."""

    @property
    def rotor_speed(self) -> float:
        """Speed [rad/s]."""

    @property
    def pitch(self) -> ArrayLike:
        """Pitch of all blades or of each [rad]."""


@dataclass(frozen=True)
class Mode:
    """One oscillation of a linear model."""

    name: str  #: From the coordinate with the largest participation, e.g. "flap_1 regressive".
    frequency: float  #: Damped frequency |Im λ|/2π [Hz]
    natural_frequency: float  #: |λ|/2π [Hz]
    damping: float  #: Damping ratio −Re λ/|λ|; negative when unstable
    eigenvalue: complex  #: λ [1/s]
    shape: NDArray[np.complex128] = field(repr=False, compare=False)
    """Right eigenvector in the states of the model, largest entry one; array (n_states,), complex."""
    dual: NDArray[np.complex128] = field(repr=False, compare=False)
    """Left eigenvector with dual · shape = 1; array (n_states,), complex."""
    participation: dict[str, float] = field(repr=False, compare=False)  #: Share of each coordinate, sum one


@dataclass(frozen=True)
class LinearModel:
    """ẋ = A x + B u, y = C x + D u for small changes about an operating point."""

    A: Array
    B: Array
    C: Array
    D: Array  #: A, B, C, D: SI units and radians; arrays (n, n), (n, m), (p, n), (p, m)
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    """state_names, input_names, output_names: the rate of a coordinate "name" is called "name_rate"."""
    operating_point: SteadyPoint | None = None  #: The steady state about which the model holds
    multiblade: bool = False  #: Blade quantities are collective, cosine and sine parts instead of blades 1, 2 and 3
    waves: WaveForces | None = None  #: Of the sea for which the drag of a floater is linear

    def select(
        self, inputs: str | Iterable[str] | None = None, outputs: str | Iterable[str] | None = None
    ) -> "LinearModel":
        """The same model with only the named inputs and outputs (sequences of str; None keeps all).

        Raises
        ------
        SimulationError
            For an unknown name.
        """
        i = _places(self.input_names, inputs, "input")
        o = _places(self.output_names, outputs, "output")
        return replace(
            self, B=self.B[:, i], C=self.C[o], D=self.D[np.ix_(o, i)],
            input_names=tuple(self.input_names[k] for k in i), output_names=tuple(self.output_names[k] for k in o),
        )  # fmt: skip

    def response(
        self, time: ArrayLike, inputs: Mapping[str, ArrayLike] | None = None, start: ArrayLike | None = None
    ) -> Array:
        """Outputs over time by the exact solution for inputs that are constant in each interval.

        Parameters
        ----------
        time : array (n_t,)
            Equally spaced [s].
        inputs : dict of str to (float or array (n_t,)), optional
            Changes of inputs from the operating point; the value at a time holds until the next.
        start : array (n,), optional
            State at the first time, zero by default.

        Returns
        -------
        array (n_t, p)
            Changes of the outputs.
        """
        time = np.asarray(time, dtype=float)
        steps = np.diff(time)
        if len(time) < 2 or not np.allclose(steps, steps[0]) or not steps[0] > 0.0:
            raise SimulationError("response needs at least two equally spaced, ascending times")
        n, m = self.B.shape
        u = np.zeros((len(time), m))
        for name, value in (inputs or {}).items():
            u[:, _places(self.input_names, (name,), "input")[0]] = value
        block = expm(np.block([[self.A, self.B], [np.zeros((m, n + m))]]) * steps[0])
        x = np.zeros(n) if start is None else np.array(start, dtype=float)
        out = np.empty((len(time), len(self.output_names)))
        for k in range(len(time)):
            out[k] = self.C @ x + self.D @ u[k]
            x = block[:n, :n] @ x + block[:n, n:] @ u[k]
        return out

    def modes(self) -> tuple[Mode, ...]:
        """Oscillations of the structure and of the water about a floater, lowest frequency first.

        The drives (pitch, yaw) follow their commands without reaction of the structure: they are left out. Modes of the
        memory of the water have the names of its states, "radiation_surge_1".
        """
        coordinates = _coordinates(self.state_names)
        drives = {name for name in coordinates if name == "yaw" or name.startswith("pitch")}
        keep = [i for i, name in enumerate(self.state_names) if name.removesuffix("_rate") not in drives]
        free = [name for name in coordinates if name not in drives]
        values, right = np.linalg.eig(self.A[np.ix_(keep, keep)])
        left = np.linalg.pinv(right)
        chosen = np.flatnonzero(values.imag > 1e-6 * (1.0 + np.abs(values)))
        chosen = chosen[np.argsort(values[chosen].imag)]
        rows = {name: [k for k, i in enumerate(keep) if self.state_names[i] in (name, f"{name}_rate")] for name in free}
        shares, names = [], []
        for k in chosen:
            part = np.abs(left[k] * right[:, k])
            share = {name: float(part[rows[name]].sum()) for name in free}
            total = sum(share.values())
            shares.append({name: value / total for name, value in share.items()})
        names = self._mode_names(chosen, right, keep, shares)
        out = []
        for k, name, share in zip(chosen, names, shares, strict=True):
            shape = np.zeros(len(self.state_names), dtype=complex)
            dual, largest = shape.copy(), right[np.abs(right[:, k]).argmax(), k]
            shape[keep], dual[keep] = right[:, k] / largest, left[k] * largest
            value = complex(values[k])
            size, frequency = abs(value), abs(value.imag) / (2.0 * np.pi)
            out.append(Mode(name, frequency, size / (2.0 * np.pi), -value.real / size, value, shape, dual, share))
        return tuple(out)

    def _mode_names(
        self,
        chosen: Integers,
        right: NDArray[np.complex128],
        keep: Sequence[int],
        shares: Sequence[Mapping[str, float]],
    ) -> list[str]:
        """Each mode takes the name in whose coordinates it takes part most; no name is given twice.

        The cosine and sine parts of a turning rotor make a whirl: with z_cosine + i z_sine large it runs with the rotor
        (progressive), with z_cosine − i z_sine against it (regressive), seen from the blade.
        """
        turning = self.operating_point is None or self.operating_point.rotor_speed > 0.0
        place = {self.state_names[i]: k for k, i in enumerate(keep)}
        candidates: dict[str, Array] = {}
        for name in shares[0] if shares else ():
            base, _, part = name.rpartition("_")
            if not (self.multiblade and part in _PARTS[1:]):
                candidates[name.replace("_collective", " collective")] = np.array([s[name] for s in shares])
            elif part == "cosine":
                cosine, sine = np.array([s[name] for s in shares]), np.array([s[f"{base}_sine"] for s in shares])
                if turning:
                    c, s = right[place[name]][chosen], right[place[f"{base}_sine"]][chosen]
                    forward, backward = np.abs(c + 1j * s) ** 2, np.abs(c - 1j * s) ** 2
                    share = forward / np.maximum(forward + backward, 1e-300)
                    candidates[f"{base} progressive"] = (cosine + sine) * share
                    candidates[f"{base} regressive"] = (cosine + sine) * (1.0 - share)
                else:
                    candidates[f"{base} tilt"], candidates[f"{base} yaw"] = cosine, sine
        if not candidates:
            return []
        table = np.array(list(candidates.values())).T
        rows, columns = linear_sum_assignment(-table)
        labels = [f"mode {k + 1}" for k in range(len(chosen))]
        for r, c in zip(rows, columns, strict=True):
            labels[r] = list(candidates)[c]
        return labels


def _coordinates(state_names: Sequence[str]) -> list[str]:
    """Names of the coordinates, without their rates, and of rates without a coordinate."""
    names = []
    for name in state_names:
        base = name.removesuffix("_rate")
        if base not in names:
            names.append(base)
    return names


def _places(names: Sequence[str], chosen: str | Iterable[str] | None, kind: str) -> list[int]:
    if chosen is None:
        return list(range(len(names)))
    chosen = (chosen,) if isinstance(chosen, str) else tuple(chosen)
    for name in chosen:
        if name not in names:
            raise SimulationError(f"{kind} {name!r} is unknown; the model has {', '.join(names)}")
    return [names.index(name) for name in chosen]


def coleman(azimuth: float) -> tuple[Array, Array, Array]:
    """Coleman's transformation of three blades and its first two derivatives by the azimuth.

    q_i = q_collective + q_cosine cos ψ_i + q_sine sin ψ_i with ψ_i = ψ + 2π (i − 1)/3.

    Parameters
    ----------
    azimuth : float
        ψ of blade 1 [rad].

    Returns
    -------
    tuple of three arrays (3, 3)
        Rows: blades; columns: collective, cosine, sine.
    """
    psi = azimuth + 2.0 * np.pi / 3.0 * np.arange(3)
    one, zero = np.ones(3), np.zeros(3)
    return (
        np.column_stack([one, np.cos(psi), np.sin(psi)]),
        np.column_stack([zero, -np.sin(psi), np.cos(psi)]),
        np.column_stack([zero, -np.cos(psi), -np.sin(psi)]),
    )


def blade_triples(names: Sequence[str]) -> tuple[list[list[int]], tuple[str, ...]]:
    """Names that belong to blades 1, 2 and 3, and how the names read in multi-blade coordinates.

    Parameters
    ----------
    names : sequence of str
        States "blade_1_flap_1", "pitch_1_rate", inputs "pitch_1" or channels "root_flap_moment_1".

    Returns
    -------
    triples : list of list of int
        Indices of the three blades' entries.
    renamed : tuple of str
    """
    index, renamed, triples = {name: i for i, name in enumerate(names)}, list(names), []
    for name in names:
        match = _BLADE_STATE.fullmatch(name) or _BLADE_CHANNEL.fullmatch(name)
        if match is None or match["blade"] != "1":
            continue
        start, end = match.span("blade")
        blades = [f"{name[:start]}{k}{name[end:]}" for k in (1, 2, 3)]
        if any(blade not in index for blade in blades):
            continue
        members = [index[blade] for blade in blades]
        triples.append(members)
        for k, part in zip(members, _PARTS, strict=True):
            renamed[k] = f"{match['base']}_{part}{match['rate'] or ''}"
    return triples, tuple(renamed)


def multiblade_transform(state_names: Sequence[str], azimuth: float, rotor_speed: float) -> tuple[Array, Array]:
    """Matrix L of x = L z between states of the blades and multi-blade states, and dL/dt at constant rotor speed.

    Parameters
    ----------
    state_names : sequence of str
        Of a model with three blades; a coordinate is followed by its rate under the name "…_rate".
    azimuth : float
        [rad].
    rotor_speed : float
        [rad/s].

    Returns
    -------
    tuple of two arrays (n, n)
    """
    t, t1, t2 = coleman(azimuth)
    n = len(state_names)
    transform, change = np.eye(n), np.zeros((n, n))
    place = {name: i for i, name in enumerate(state_names)}
    for members in blade_triples(state_names)[0]:
        transform[np.ix_(members, members)] = t
        change[np.ix_(members, members)] = rotor_speed * t1
        rates = [f"{state_names[i]}_rate" for i in members]
        if all(name in place for name in rates):
            rate = [place[name] for name in rates]
            transform[np.ix_(rate, members)] = rotor_speed * t1
            change[np.ix_(rate, members)] = rotor_speed**2 * t2
    return transform, change


def multiblade_model(model: LinearModel, azimuth: float, rotor_speed: float) -> LinearModel:
    """A model of a three-bladed rotor at one azimuth in multi-blade coordinates.

    With x = L(ψ) z, where positions are T z and rates T ż + Ω T' z: ż = L⁻¹ (A L − Ω L') z + L⁻¹ B T u
    (Bir, Multiblade coordinate transformation and its application to wind turbine analysis, AIAA 2008-1300).

    Parameters
    ----------
    azimuth : float
        [rad].
    rotor_speed : float
        [rad/s].
    """
    transform, change = multiblade_transform(model.state_names, azimuth, rotor_speed)
    _, states = blade_triples(model.state_names)
    t = coleman(azimuth)[0]
    inputs, input_names = _block(model.input_names, t)
    outputs, output_names = _block(model.output_names, t)
    # the collective part of the blades is the collective demand, which the model has under the same name already
    once = [i for i, name in enumerate(input_names) if name not in input_names[:i]]
    input_names = tuple(input_names[i] for i in once)
    back = np.linalg.inv(transform)
    return replace(
        model,
        A=back @ (model.A @ transform - change),
        B=back @ model.B @ inputs[:, once],
        C=np.asarray(np.linalg.solve(outputs, model.C @ transform), dtype=np.float64),
        D=np.asarray(np.linalg.solve(outputs, model.D @ inputs[:, once]), dtype=np.float64),
        state_names=states, input_names=input_names, output_names=output_names, multiblade=True,
    )  # fmt: skip


def _block(names: Sequence[str], t: Array) -> tuple[Array, tuple[str, ...]]:
    """Coleman's transformation of all triples among the names."""
    triples, renamed = blade_triples(names)
    out = np.eye(len(names))
    for members in triples:
        out[np.ix_(members, members)] = t
    return out, renamed


def reflected_model(model: LinearModel, state_names: Sequence[str], n_lines: int | None) -> LinearModel:
    """The linear model of a turbine from that of its mirror image, see `wt_gym.simulation.channels`.

    Parameters
    ----------
    state_names : sequence of str
        Of the states of the operating point, which a model of a locked generator does not have all.
    n_lines : int or None
        Mooring lines, as of `channel_table`.
    """
    point, waves = model.operating_point, model.waves
    size = 3 if point is None else len(point.pitch), n_lines
    signs = {"yaw": -1.0, "wind_y": -1.0} | {f"wave_force_{m}": s for m, s in zip(MOTIONS, REFLECTION_6, strict=True)}
    channels = dict(zip((c.name for c in channel_table(*size)), parities(*size), strict=True))
    inputs = np.array([signs.get(name, 1.0) for name in model.input_names])
    outputs = np.array([channels.get(name, 1.0) for name in model.output_names])  # names of no channel are of blades
    states = state_parities(model.state_names)
    if point is not None:
        point = replace(
            point, yaw=-point.yaw, states=point.states * state_parities(state_names),
            outputs=point.outputs * parities(*size),
        )  # fmt: skip
    return replace(
        model,
        A=model.A * np.outer(states, states),
        B=model.B * np.outer(states, inputs),
        C=model.C * np.outer(outputs, states),
        D=model.D * np.outer(outputs, inputs),
        operating_point=point,
        waves=None if waves is None else replace(waves, amplitude=waves.amplitude * REFLECTION_6),
    )
