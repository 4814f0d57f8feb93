"""Wind that does not change in time: uniform, power-law, logarithmic or jet profile, with veer, yaw and inclination."""

import math
from dataclasses import dataclass

from wt_gym.base.errors import InflowError
from wt_gym.base.quantities import Array
from wt_gym.wind.inflow import POSITIVE, PointInflow, check_numbers
from wt_gym.wind.inflow_kernels import mean_velocity


@dataclass(frozen=True)
class SteadyInflow(PointInflow):
    """Steady wind over flat ground.

    The speed at height z is

    - uniform: ``speed`` everywhere, below the ground too (there is no ground to feel);
    - power law: ``speed * (z / hub_height)**shear_exponent`` for z > 0, zero for z ≤ 0;
    - negative shear: the power law with a negative exponent, which keeps its speed below a tenth of the hub height;
    - logarithmic: ``speed * ln(z / z0) / ln(hub_height / z0)`` for z > z0, zero for z ≤ z0 (``roughness_length``);
    - low-level jet: ``(1 - jet_share) * V(z) + jet_share * speed * J(z) / J(hub_height)`` for z > 0, zero for z ≤ 0,
      with V one of the profiles above and J the profile of Prandtl's slope flow with its nose at ``jet_height``,
      ``J = sqrt(2) exp(pi/4 - x) sin(x)``, ``x = pi z / (4 jet_height)`` (Prandtl, Führer durch die Strömungslehre,
      1942; Grisogono and Oerlemans, Tellus A 54 (2002) 453). J is 1 at the nose; at twice the height of
      the nose it is 0.645, at four times it is 0.

    All are continuous in z, except the uniform share of a jet at the ground. The direction the wind blows towards is
    turned from +x by ``yaw_misalignment + veer * (z - hub_height)``, positive counter-clockwise seen from above, so a
    positive misalignment blows towards +y and gives a positive yaw error (wind direction minus nacelle direction) on a
    nacelle that faces −x. The whole vector is raised by ``inclination``, keeping its magnitude.

    Parameters
    ----------
    speed
        Wind speed at hub height [m/s], at least 0.
    hub_height
        Reference height [m].
    shear_exponent
        Power-law exponent, -1 to 1; 0 is uniform, below 0 the wind falls with height. IEC 61400-1 takes 0.2 for normal
        conditions.
    roughness_length
        Roughness length z0 of the logarithmic profile [m]; excludes ``shear_exponent``.
    veer
        Change of direction with height [rad/m], counter-clockwise with height positive. Wind that veers in the
        meteorological sense (clockwise with height, usual in the northern hemisphere) has a negative value.
    yaw_misalignment
        Wind direction at hub height relative to +x [rad], counter-clockwise from above positive.
    inclination
        Upflow angle [rad], rising wind positive.
    jet_height
        Height of the nose of a low-level jet [m], more than a third of the hub height; none by default.
    jet_share
        Share of the hub speed that the jet carries, above 0 to 1; 1 is the jet alone.

    Raises
    ------
    InflowError
        A parameter is not finite or out of range, or both profiles are asked for.
    """

    speed: float
    hub_height: float = 90.0
    shear_exponent: float = 0.0
    roughness_length: float | None = None
    veer: float = 0.0
    yaw_misalignment: float = 0.0
    inclination: float = 0.0
    jet_height: float | None = None
    jet_share: float = 0.5

    def __post_init__(self) -> None:
        check_numbers(
            self, speed=("m/s", 0.0, 200.0), hub_height=("m", *POSITIVE), shear_exponent=("(no unit)", -1.0, 1.0),
            veer=("rad/m", -0.05, 0.05), yaw_misalignment=("rad", -math.pi, math.pi),
            inclination=("rad", -0.5 * math.pi, 0.5 * math.pi), jet_share=("(no unit)", 0.0, 1.0, True),
        )  # fmt: skip
        if self.jet_height is not None:  # much lower, at a quarter of the hub height, the jet has no wind at the hub
            check_numbers(self, jet_height=("m", self.hub_height / 3.0, math.inf, True))
        if self.roughness_length is None:
            return
        check_numbers(self, roughness_length=("m", *POSITIVE))
        if self.roughness_length >= self.hub_height:
            raise InflowError(
                f"roughness_length must be below the hub height {self.hub_height} m; got {self.roughness_length}"
            )
        if self.shear_exponent != 0.0:
            raise InflowError(
                "shear_exponent (power law) and roughness_length (logarithmic) exclude each other; "
                f"got {self.shear_exponent} and {self.roughness_length}"
            )

    @property
    def mean_speed(self) -> float:
        """Wind speed at hub height [m/s]."""
        return self.speed

    @property
    def is_uniform(self) -> bool:
        """Whether speed and direction are the same at every height."""
        sheared = self.shear_exponent != 0.0 or self.roughness_length is not None or self.jet_height is not None
        return not sheared and self.veer == 0.0

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        return f"steady {self.speed:g} m/s at {self.hub_height:g} m, {self.profile_description}"

    @property
    def profile_description(self) -> str:
        """The profile and angles in words."""
        if self.roughness_length is not None:
            parts = [f"logarithmic profile (z0 = {self.roughness_length:g} m)"]
        elif self.shear_exponent != 0.0:
            parts = [f"power-law profile (exponent {self.shear_exponent:g})"]
        else:
            parts = ["uniform profile"]
        if self.jet_height is not None:
            parts.append(f"low-level jet (nose at {self.jet_height:g} m, share {self.jet_share:g})")
        if self.veer:
            parts.append(f"veer {math.degrees(self.veer):.3g} deg/m")
        if self.yaw_misalignment:
            parts.append(f"yaw misalignment {math.degrees(self.yaw_misalignment):.3g} deg")
        if self.inclination:
            parts.append(f"inclination {math.degrees(self.inclination):.3g} deg")
        return ", ".join(parts)

    @property
    def kernel_profile(self) -> tuple[float, float, float, float, float, float, float]:
        """Speed, hub height, exponent, roughness length, jet height (0: none), jet share, veer, as the kernels take."""
        layer = self.speed, self.hub_height, self.shear_exponent, self.roughness_length or 0.0
        return *layer, self.jet_height or 0.0, self.jet_share, self.veer

    def _fill(self, rows: Array, time: float, out: Array) -> int:
        return int(mean_velocity(rows, self.kernel_profile, self.yaw_misalignment, self.inclination, out))


class OnSteadyWind(PointInflow):
    """Base of winds that change about a steady one."""

    steady: SteadyInflow

    def _check_steady(self) -> None:
        if not isinstance(self.steady, SteadyInflow):
            raise InflowError(f"steady must be a SteadyInflow; got {type(self.steady).__name__}")

    @property
    def mean_speed(self) -> float:
        """Speed of the steady wind at hub height [m/s]."""
        return self.steady.speed

    @property
    def hub_height(self) -> float:
        """Hub height [m]."""
        return self.steady.hub_height
