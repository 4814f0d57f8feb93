"""What a policy would have cost in a recorded episode: loads as recorded, plus what its other offsets change of them.

About the offsets u of the policy that was recorded, loads are linear in the offsets of another one,

    y(u') = y + G * (u' - u),

with impulse responses G that were identified under the same base controller. The cost is the weighted lifetime cost
(`wt_gym.analysis.metrics`) over that of the published controller in the same wind speed, with the fatigue as
rainflow counting gives it, so it is exact for the recorded policy and its gradient is that of the model. With a dial
(`wt_gym.envs.dial`) its factors weigh the parts of the cost as they weigh those of the reward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from wt_gym.analysis.metrics import BLADE_EXPONENT, LIFETIME_COST_WEIGHTS, TOWER_EXPONENT
from wt_gym.envs.dial import DIAL_NAMES
from wt_gym.learning.pretraining.fatigue import damage_equivalent_load

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from wt_gym.learning.pretraining.episodes import RecordedEpisode

__all__ = ["OUTPUTS", "Limits", "LinearizedEpisode", "Plants", "load_metrics", "plant_outputs", "tensor"]

OUTPUTS = ("flap_mean", "flap_tilt", "flap_yaw", "tower_fore_aft", "tower_side_side", "power")
"""What impulse responses give [MN m, MW]."""

_MEGA = 1e6
_LOOPS = 2
"""Picard iterations of the loop from offsets over observations to offsets."""
_DIALED = {
    "blade_flap_del": "fatigue", "tower_fore_aft_del": "fatigue", "tower_side_side_del": "fatigue",
    "captured_power": "power", "pitch_duty_cycle": "travel",
}  # fmt: skip
"""What of a dial weighs a metric."""


def plant_outputs(episode: RecordedEpisode) -> NDArray[np.float64]:
    """`OUTPUTS` (6, n + 1) of an episode."""
    n = len(episode.flap)
    angles = episode.azimuth + 2.0 * math.pi / n * np.arange(n)[:, None]
    outputs: NDArray[np.float64] = (
        np.stack([
            episode.flap.mean(0),
            2.0 / n * (episode.flap * np.cos(angles)).sum(0),
            2.0 / n * (episode.flap * np.sin(angles)).sum(0),
            *episode.tower,
            episode.power,
        ])
        / _MEGA
    )  # fmt: skip
    return outputs


class Plants:
    """Impulse responses at several mean winds, between which the wind speed chooses.

    Parameters
    ----------
    speeds : sequence of float
        Rising [m/s].
    responses : numpy.ndarray, shape (n, n_out, 3, n_taps)
        Of outputs to mean, tilt and yaw, per radian; entry l is what an offset does l + 1 steps later. Of `OUTPUTS`
        [MN m/rad, MW/rad], or of what the agent sees.
    """

    def __init__(self, speeds: tuple[float, ...], responses: NDArray[np.float64]) -> None:
        self.speeds, self.responses = speeds, responses
        self._spectra: dict[tuple[float, int], torch.Tensor] = {}

    def at(self, speed: float) -> NDArray[np.float64]:
        """Responses at a mean wind (n_out, 3, n_taps), those of the nearest beyond the ends."""
        x = min(max(speed, self.speeds[0]), self.speeds[-1])
        k = min(int(np.searchsorted(self.speeds, x, side="right")) - 1, max(len(self.speeds) - 2, 0))
        if len(self.speeds) == 1:
            alone: NDArray[np.float64] = self.responses[0]
            return alone
        w = (x - self.speeds[k]) / (self.speeds[k + 1] - self.speeds[k])
        out: NDArray[np.float64] = (1.0 - w) * self.responses[k] + w * self.responses[k + 1]
        return out

    def respond(self, speed: float, offsets: torch.Tensor) -> torch.Tensor:
        """Changes (n_out, n + 1) by offsets (3, n): sample k follows from the offsets 0 … k - 1."""
        steps = offsets.shape[-1]
        spectrum = self._spectrum(speed, steps)
        size = 2 * (spectrum.shape[-1] - 1)
        product = torch.einsum("ojf,jf->of", spectrum, torch.fft.rfft(offsets, n=size))
        changed = torch.fft.irfft(product, n=size)[:, :steps]
        return torch.cat([torch.zeros(len(changed), 1), changed], 1)

    def _spectrum(self, speed: float, steps: int) -> torch.Tensor:
        """Transform of the responses for a convolution with so many samples, kept."""
        size = 1 << math.ceil(math.log2(steps + self.responses.shape[-1]))
        key = (round(speed, 1), size)
        if key not in self._spectra:
            found = np.fft.rfft(self.at(key[0]), n=size).astype(np.complex64)
            self._spectra[key] = torch.from_numpy(found)
        return self._spectra[key]


@dataclass(frozen=True)
class Limits:
    """From actions to the offsets that act.

    Attributes
    ----------
    mean, tilt_yaw : float
        Offset at an action of one [rad].
    washout : float or None
        Time constant of the high-pass filter of the mean [s].
    """

    mean: float
    tilt_yaw: float
    washout: float | None

    def offsets(self, actions: torch.Tensor, share: torch.Tensor, dt: float) -> torch.Tensor:
        """Offsets (3, n) [rad] of actions (n, 3), as far as shares (3, n) let them; rates have no limit."""
        u = actions.clamp(-1.0, 1.0).T
        mean = self.mean * u[:1]
        if self.washout is not None:
            mean = mean - _low_pass(mean, self.washout, dt)
        return share * torch.cat([mean, self.tilt_yaw * u[1:]])


def _low_pass(series: torch.Tensor, time_constant: float, dt: float) -> torch.Tensor:
    """First-order low-pass (1, n) that starts at zero."""
    n = series.shape[-1]
    kept = math.exp(-dt / time_constant)
    kernel = (1.0 - kept) * kept ** torch.arange(n, dtype=torch.float64)
    size = 1 << math.ceil(math.log2(2 * n))
    product = torch.fft.rfft(series.double(), n=size) * torch.fft.rfft(kernel, n=size)
    passed: torch.Tensor = torch.fft.irfft(product, n=size)[..., :n].to(series.dtype)
    return passed


def load_metrics(
    flap: torch.Tensor, tower: torch.Tensor, pitch: torch.Tensor, dt: float, full_rate: float, skip: int,
    exponents: tuple[float, float],
) -> dict[str, torch.Tensor]:  # fmt: skip
    """Metrics of the lifetime cost [MN m], of all blades alike.

    Parameters
    ----------
    flap, pitch : torch.Tensor, shape (n_blades, n + 1)
        [MN m], [rad].
    tower : torch.Tensor, shape (2, n + 1)
        [MN m].
    dt, full_rate : float
        [s], [rad/s].
    skip : int
        Samples at the start that do not count.
    exponents : (float, float)
        Of blades and tower.
    """
    time = (flap.shape[1] - skip) * dt
    blades = [damage_equivalent_load(row[skip:], time, exponents[0]) for row in flap]
    aft, side = (damage_equivalent_load(row[skip:], time, exponents[1]) for row in tower)
    return {
        "blade_flap_del": torch.stack(blades).mean(),
        "tower_fore_aft_del": aft,
        "tower_side_side_del": side,
        "pitch_duty_cycle": pitch[:, skip:].diff(dim=1).abs().mean() / dt / full_rate,
    }


class LinearizedEpisode:
    """A recorded episode as a function of the policy.

    Parameters
    ----------
    episode : RecordedEpisode
    actor : callable
        Policy under which it was recorded: actions (n, 3) of observations (n, n_obs).
    plants : Plants
    limits : Limits
    baseline : dict
        Metrics of the published controller in this wind speed.
    full_rate : float
        Of the pitch drives [rad/s].
    rated_power : float
        [W].
    skip : float
        Start that does not count [s].
    dial_at : sequence of int
        Places of the factors of a dial in an observation, in the order of `DIAL_NAMES`; none without a dial.
    seen : Plants, optional
        Responses of what the agent sees to its own offsets, where the model of the base controller does not hold; by
        default there are none.
    """

    def __init__(
        self,
        episode: RecordedEpisode,
        actor: Callable[[torch.Tensor], torch.Tensor],
        plants: Plants,
        limits: Limits,
        baseline: dict[str, float],
        full_rate: float,
        rated_power: float,
        skip: float,
        dial_at: Sequence[int] = (),
        seen: Plants | None = None,
    ) -> None:
        self._dial_at, self._plants, self._seen = list(dial_at), plants, seen
        self.speed, self.seed, self.steps, self._dt = episode.speed, episode.seed, episode.steps, episode.dt
        self._limits, self._baseline, self._full_rate = limits, baseline, full_rate
        self._skip = round(skip / episode.dt)
        self.observations = torch.from_numpy(episode.observations)
        cyclic = episode.share * episode.individual
        self._share, self._gain = tensor(np.stack([episode.share, cyclic, cyclic])), episode.pitch_gain
        n = len(episode.flap)
        of_blades = 2.0 * math.pi / n * np.arange(n)[:, None]
        ahead = episode.read_azimuth + episode.lead * episode.read_speed + of_blades
        still = episode.azimuth + of_blades
        self._pitch_cos, self._pitch_sin = tensor(np.cos(ahead)), tensor(np.sin(ahead))
        self._flap_cos, self._flap_sin = tensor(np.cos(still)), tensor(np.sin(still))
        self._flap, self._tower = tensor(episode.flap / _MEGA), tensor(episode.tower / _MEGA)
        self._pitch = tensor(episode.pitch)
        power = np.minimum(episode.power, rated_power)
        self._power = float(power[self._skip :].mean()) / _MEGA
        with torch.no_grad():
            self._acted = limits.offsets(actor(self.observations), self._share, self._dt)

    def offsets(
        self,
        actor: Callable[[torch.Tensor], torch.Tensor],
        noise: float = 0.0,
        dial: tuple[float, ...] | None = None,
    ) -> torch.Tensor:
        """Offsets (3, n) of a policy [rad].

        Where the agent sees its own offsets u, these solve u = pi(o + H * (u - u_recorded)); Picard iterations from the
        recorded observations give them as far as the loop is weak.

        Parameters
        ----------
        actor : callable
        noise : float
            Standard deviation of what is added to the observations.
        dial : tuple of float, optional
            Factors that the policy sees instead of those of the recording.
        """
        seen = self.observations
        if noise > 0.0:
            seen = seen + noise * torch.randn_like(seen)
        if dial is not None:
            seen = seen.clone()
            seen[:, self._dial_at] = torch.tensor([math.log2(factor) for factor in dial])
        offsets = self._limits.offsets(actor(seen), self._share, self._dt)
        if self._seen is not None:
            for _ in range(_LOOPS):
                back = self._seen.respond(self.speed, offsets - self._acted)[:, : self.steps].T
                offsets = self._limits.offsets(actor(seen + back), self._share, self._dt)
        return offsets

    def metrics(self, offsets: torch.Tensor, exponents: tuple[float, float]) -> dict[str, torch.Tensor]:
        """Metrics under offsets (3, n) [rad]; power is the recorded one less what the offsets take, never more."""
        more = offsets - self._acted
        changed = self._plants.respond(self.speed, more)
        flap = self._flap + changed[0] + changed[1] * self._flap_cos + changed[2] * self._flap_sin
        moved = self._gain * (more[0] + more[1] * self._pitch_cos + more[2] * self._pitch_sin)
        pitch = torch.cat([self._pitch[:, :1], self._pitch[:, 1:] + moved], 1)
        found = load_metrics(flap, self._tower + changed[3:5], pitch, self._dt, self._full_rate, self._skip, exponents)
        found["captured_power"] = self._power + changed[5, self._skip :].mean().clamp(max=0.0)
        return found

    def cost(
        self,
        offsets: torch.Tensor,
        exponents: tuple[float, float] = (BLADE_EXPONENT, TOWER_EXPONENT),
        dial: tuple[float, ...] | None = None,
    ) -> torch.Tensor:
        """Lifetime cost under offsets less that of the published controller.

        Parameters
        ----------
        offsets : torch.Tensor, shape (3, n)
            [rad].
        exponents : (float, float)
            Of blades and tower. With others than those of the metrics, loads are scaled to agree with them for the
            recorded policy: a smaller exponent spreads the gradient over more cycles.
        dial : tuple of float, optional
            Factors on the parts of the cost.
        """
        return self.cost_and_travel(offsets, exponents, dial)[0]

    def cost_and_travel(
        self,
        offsets: torch.Tensor,
        exponents: tuple[float, float] = (BLADE_EXPONENT, TOWER_EXPONENT),
        dial: tuple[float, ...] | None = None,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """`cost`, and the mean pitch travel of the blades [rad/s]."""
        now = self.metrics(offsets, exponents)
        travel = now["pitch_duty_cycle"] * self._full_rate
        true = (BLADE_EXPONENT, TOWER_EXPONENT)
        if exponents != true:
            scale = self._scales(exponents)
            now = {name: value * scale.get(name, 1.0) for name, value in now.items()}
        total = torch.zeros(())
        for name, value in now.items():
            before = self._baseline[name]
            size = 1.0 if name == "pitch_duty_cycle" else before
            part = LIFETIME_COST_WEIGHTS[name] * (value - before) / size
            total = total + (part if dial is None else dial[DIAL_NAMES.index(_DIALED[name])] * part)
        return total, travel

    def _scales(self, exponents: tuple[float, float]) -> dict[str, float]:
        """Loads of the recorded policy with the exponents of the metrics over those with others."""
        if getattr(self, "_scaled_for", None) != exponents:
            with torch.no_grad():
                true = self.metrics(self._acted, (BLADE_EXPONENT, TOWER_EXPONENT))
                other = self.metrics(self._acted, exponents)
            names = ("blade_flap_del", "tower_fore_aft_del", "tower_side_side_del")
            self._scaled_for, self._scale = exponents, {name: float(true[name] / other[name]) for name in names}
        return self._scale


def tensor(values: NDArray[np.float64]) -> torch.Tensor:
    """Array in single precision."""
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
