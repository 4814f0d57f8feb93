"""Numbers of a site in place of those of a turbine, and everything that depends on the density of the air."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.control.controllers.own import gain_of_table
from wt_gym.control.design import design_point, reference_flap_moment
from wt_gym.control.operating_point import operating_point, starting_point, torque_curve
from wt_gym.control.rotor import rotor_table
from wt_gym.envs.power import available_power
from wt_gym.simulation.contract import fingerprint
from wt_gym.turbines import load_turbine
from wt_gym.turbines.model import SITE, at_controller_density, with_site
from wt_gym.wind import SeriesInflow, SteadyInflow

NREL, IEA = load_turbine("nrel_5mw"), load_turbine("iea_15mw")
OTHER = replace(NREL, drivetrain=replace(NREL.drivetrain, rated_power=4.0e6))
"""A turbine that no rule knows by its size."""
SHARE = 0.8


@pytest.mark.parametrize("turbine", [NREL, IEA, OTHER])
def test_density_reaches_the_wind_and_not_the_controller(turbine):
    high = with_site(turbine, {"air_density": SHARE * turbine.air_density})
    assert (high.air_density, high.controller_air_density) == (SHARE * turbine.air_density, turbine.air_density)
    assert torque_curve(high).region_2_gain == pytest.approx(torque_curve(turbine).region_2_gain, rel=1e-9)
    for name in ("peak_power_coefficient", "tip_speed_ratio"):
        assert getattr(design_point(high), name) == pytest.approx(getattr(design_point(turbine), name), rel=1e-9)
    # the power of the wind at rated is what it was
    assert high.rated_wind_speed == pytest.approx(turbine.rated_wind_speed * SHARE ** (-1.0 / 3.0), rel=1e-12)
    low_wind = 0.5 * turbine.rated_wind_speed
    assert available_power(high, low_wind) == pytest.approx(SHARE * available_power(turbine, low_wind), rel=1e-12)
    # Betz thrust at rated: rho V^2 with rho V^3 kept
    ratio = reference_flap_moment(high) / reference_flap_moment(turbine)
    assert ratio == pytest.approx(SHARE ** (1.0 / 3.0), rel=1e-12)


@pytest.mark.parametrize("turbine", [NREL, IEA, OTHER])
def test_the_controller_follows_the_density_where_it_is_asked_to(turbine):
    density = SHARE * turbine.air_density
    retuned = with_site(turbine, {"air_density": density, "controller_air_density": density})
    before, after = torque_curve(turbine), torque_curve(retuned)
    limit = 0.95 * before.rated_power / before.rated_generator_speed**3
    if before.region_2_gain < limit * (1 - 1e-9):
        assert after.region_2_gain == pytest.approx(SHARE * before.region_2_gain, rel=1e-12)
    else:  # OTHER is held at its limit, which hides how far above it is
        assert after.region_2_gain <= limit
    only = with_site(turbine, {"controller_air_density": density})
    assert torque_curve(only).region_2_gain == after.region_2_gain
    assert only.air_density == turbine.air_density


def test_tables_of_the_rotor_have_the_coefficients_of_the_turbine_and_the_air_of_the_site():
    high = with_site(NREL, {"air_density": 1.0})
    table, own = rotor_table(high), rotor_table(NREL)
    assert (table.air_density, own.air_density) == (1.0, NREL.air_density)
    np.testing.assert_array_equal(table.power, own.power)
    assert table.torque(8.0, 1.0, 0.0) == pytest.approx(own.torque(8.0, 1.0, 0.0) / NREL.air_density, rel=1e-12)
    assert gain_of_table(high, table) == pytest.approx(gain_of_table(NREL, own), rel=1e-12)


def test_sites_are_told_apart_and_written_down():
    site = {"air_density": 1.1, "cut_out": 30.0, "turbulence_class": "A"}
    moved = with_site(NREL, site)
    assert (moved.cut_out, moved.turbulence_class, moved.cut_in) == (30.0, "A", NREL.cut_in)
    assert moved.notes[-1] == "site: air_density 1.1 kg/m^3, cut_out 30.0 m/s, turbulence_class A"
    assert fingerprint(moved) != fingerprint(NREL)
    assert fingerprint(with_site(NREL, None)) == fingerprint(with_site(NREL, {})) == fingerprint(NREL)
    assert fingerprint(NREL.with_site(**site)) == fingerprint(moved)
    assert fingerprint(at_controller_density(with_site(NREL, {"air_density": 1.1}))) == fingerprint(NREL)
    again = with_site(with_site(NREL, {"air_density": 1.1}), {"air_density": 1.0})
    assert again.controller_air_density == NREL.air_density
    assert again.rated_wind_speed == pytest.approx(with_site(NREL, {"air_density": 1.0}).rated_wind_speed, rel=1e-12)


@pytest.mark.parametrize(
    ("site", "message"),
    [
        ({"air_densty": 1.1}, "site has no 'air_densty'; did you mean 'air_density'"),
        ({"altitude": 800.0}, "Allowed: " + ", ".join(SITE)),
        ({"air_density": "thin"}, "air_density"),
        ({"air_density": 0.0}, "air_density"),
        ({"air_density": True}, "air_density"),
        ({"controller_air_density": -1.0}, "controller_air_density"),
        ({"cut_out": 5.0}, "cut_out"),
        ({"iec_class": "V"}, "iec_class"),
        ({"turbulence_class": "D"}, "turbulence_class"),
        ([("air_density", 1.1)], "site must map names to values"),
    ],
)
def test_wrong_sites_are_refused(site, message):
    with pytest.raises(TurbineDefinitionError, match=message):
        with_site(NREL, site)


def test_where_a_turbine_starts():
    assert starting_point(NREL, SteadyInflow(9.0)) == operating_point(NREL, 9.0)
    idle = starting_point(NREL, SteadyInflow(0.0))
    assert idle == replace(operating_point(NREL, NREL.cut_in), generator_torque=0.0)
    ramp = SeriesInflow.ramp(8.0, 20.0, 10.0, 30.0)
    assert starting_point(NREL, ramp) == operating_point(NREL, 8.0)
    assert math.isclose(ramp.mean_speed, 14.0)
    # beyond cut-out along the slope of the last 5 % below it
    ends = [operating_point(NREL, share * NREL.cut_out).pitch for share in (0.95, 1.0)]
    assert starting_point(NREL, SteadyInflow(1.2 * NREL.cut_out)).pitch == pytest.approx(5 * ends[1] - 4 * ends[0])
    assert starting_point(NREL, SteadyInflow(100.0)).pitch == NREL.pitch.max_pitch
