"""OpenFAST models as turbines: frequencies and operation beside the same turbine from windIO.

The models are those that the package ``rosco`` brings. It is large with what it requires and no requirement of the
tests: ``pip install --no-deps rosco`` suffices.
"""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wt_gym.experiment.run import run_baseline
from wt_gym.simulation import Recorder, Simulator
from wt_gym.simulation.campbell import campbell
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.modes import clamped_modes, select_modes
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade import rotation_about_z
from wt_gym.turbines.openfast import read_openfast
from wt_gym.turbines.openfast_text import TextFile
from wt_gym.wind import SteadyInflow

_ROSCO = importlib.util.find_spec("rosco")
CASES = Path(_ROSCO.origin).parents[1] / "Examples" / "Test_Cases" if _ROSCO and _ROSCO.origin else Path("missing")
NREL_5MW = CASES / "NREL-5MW" / "NREL-5MW.fst"
IEA_15MW = CASES / "IEA-15-240-RWT" / "IEA-15-240-RWT-Monopile" / "IEA-15-240-RWT-Monopile.fst"
BAR_10 = CASES / "BAR_10" / "BAR_10.fst"
NREL_2P8 = CASES / "NREL_2p8_127" / "NREL-2p8-127.fst"

pytestmark = pytest.mark.skipif(
    not NREL_5MW.is_file(), reason="the models of rosco are not installed: pip install --no-deps rosco"
)


def frequencies(turbine):
    """Frequencies [Hz] of the standing turbine without air, by the names of the modes."""
    inflow = SteadyInflow(turbine.rated_wind_speed, hub_height=turbine.hub_height)
    simulator = Simulator(turbine, inflow=inflow, fidelity="training")
    diagram = campbell(simulator, rotor_speeds=np.zeros(1), aerodynamics="none", generator="locked", n_azimuths=1)
    return dict(zip(diagram.names, diagram.frequency[:, 0], strict=True))


@pytest.mark.parametrize(
    ("path", "name", "blade"), [(NREL_5MW, "nrel_5mw", "elastodyn"), (IEA_15MW, "iea_15mw", "beamdyn")]
)
def test_frequencies_are_those_of_the_windio_turbine(path, name, blade):
    """The IEA 15-MW with its BeamDyn blade: its ElastoDyn blade is another one, of 68.5 instead of 67.0 t.

    Higher modes of the rotor with tower torsion differ by up to 1.6 % (flap_2 regressive) with the yaw spring and the
    nacelle inertia of the model; with those of the windIO file all modes agree within 0.1 %.
    """
    found, wanted = frequencies(read_openfast(path, blade=blade)), frequencies(load_turbine(name))
    modes = [mode for mode in wanted if mode.startswith(("fore_aft_1", "side_side_1", "flap_1", "edge_1"))]
    assert len(modes) >= 7
    for mode in modes:
        assert found[mode] == pytest.approx(wanted[mode], rel=0.01), mode


@pytest.mark.parametrize(
    ("path", "blade_file", "least"),
    [
        (NREL_5MW, "NRELOffshrBsline5MW_Blade.dat", 0.98),
        (IEA_15MW, "../IEA-15-240-RWT/IEA-15-240-RWT_ElastoDyn_blade.dat", 0.98),
        (BAR_10, "BAR_10_ElastoDyn_blade.dat", 0.94),  # its polynomial is not that of the blade in the file
        (NREL_2P8, "NREL-2p8-127_ElastoDyn_blade.dat", 0.98),
    ],
)
def test_blades_swing_as_their_own_mode_shapes_say(path, blade_file, least):
    """Rayleigh's quotient of the file's flapwise shape bounds the frequency of the blade without twist from above."""
    blade, file, x = (
        read_openfast(path, blade="elastodyn").blade,
        TextFile(path.parent / blade_file),
        np.linspace(0.0, 1.0, 2001),
    )
    table = file.table("NBlInpSt", "BlFract")
    terms = [(k, file.number(f"BldFl1Sh({k})")) for k in range(2, 7)]
    shape = sum(c * x**k for k, c in terms)
    curvature = sum(c * k * (k - 1) * x ** (k - 2) for k, c in terms) / blade.length**2
    mass = np.interp(x, table["blfract"], table["bmassden"]) * file.number("AdjBlMs")
    stiffness = np.interp(x, table["blfract"], table["flpstff"]) * file.number("AdjFlSt")
    bound = np.sqrt(np.trapezoid(stiffness * curvature**2, x) / np.trapezoid(mass * shape**2, x)) / (2.0 * np.pi)
    s, turn = blade.structure, rotation_about_z(np.radians(table["strctwst"]))
    back, rigid = np.swapaxes(turn, -1, -2), np.isinf(s.stiffness)
    untwisted = np.where(rigid, np.inf, turn @ np.where(rigid, 0.0, s.stiffness) @ back)
    straight = np.outer(s.station, [0.0, 0.0, 1.0])
    modes = clamped_modes(Beam(BeamSections(s.station, untwisted, turn @ s.inertia @ back, straight), 24), 8)
    assert least * bound < modes.frequency[select_modes(modes, flap=1)[0]] < 1.002 * bound


@pytest.mark.parametrize(("path", "discon"), [(NREL_5MW, "DISCON.IN"), (NREL_2P8, "NREL-2p8-127_DISCON.IN")])
def test_the_inertia_about_the_shaft_is_that_of_elastodyn(path, discon):
    """ROSCO's WE_Jtot of these two models is the sum of ElastoDyn's rotor inertia and GenIner GBRatio^2.

    That of the IEA 15-MW belongs to a former blade, that of BAR_10 to none of its two.
    """
    turbine = load_turbine(path)
    s, r = turbine.blade.structure, turbine.hub.radius
    about_root = s.mass_moment(2) + 2.0 * r * s.mass_moment(1) + r**2 * s.mass_moment(0)
    rotor = turbine.hub.inertia_axial + turbine.n_blades * about_root * np.cos(turbine.hub.cone) ** 2
    train = turbine.drivetrain
    expected = TextFile(path.parent / discon, titles=0).number("WE_Jtot")
    assert rotor + train.generator_inertia * train.gear_ratio**2 == pytest.approx(expected, rel=0.005)


def test_all_models_load_and_their_reference_points_are_those_of_windio():
    for path in (BAR_10, NREL_2P8):
        assert load_turbine(path).control is not None
    found, wanted = load_turbine(IEA_15MW).blade, load_turbine("iea_15mw").blade
    z = np.linspace(2.0, 112.0, 40)  # the tip of the windIO file is finer
    np.testing.assert_allclose(found.le_offset_at(z), wanted.le_offset_at(z), atol=0.005)
    np.testing.assert_allclose(found.chord_at(z), wanted.chord_at(z), rtol=0.005)
    np.testing.assert_allclose(found.twist_at(z), wanted.twist_at(z), atol=np.radians(0.1))
    np.testing.assert_allclose(found.axis_at(z), wanted.axis_at(z), atol=0.05)


def operation(turbine, wind):
    simulator = Simulator(turbine, inflow=SteadyInflow(wind, hub_height=turbine.hub_height), fidelity="training")
    recorder = Recorder(simulator)
    run_baseline(simulator, 200.0, recorder=recorder)
    last = recorder.to_dataset().sel(time=slice(170.0, None)).mean()
    return [float(last[name]) for name in ("rotor_speed", "generator_power", "aero_thrust")], float(last.pitch_1)


@pytest.mark.slow
@pytest.mark.parametrize("wind", [8.0, 11.0, 15.0, 20.0])
@pytest.mark.parametrize(("path", "name"), [(NREL_5MW, "nrel_5mw"), (IEA_15MW, "iea_15mw")])
def test_operation_is_that_of_the_windio_turbine(path, name, wind):
    """Rotor speed, power and thrust within 1 %, pitch within 1 % or 0.1 degrees, with one controller for both.

    The controller of the model's own files smooths its set point near rated power, that of the catalog does not.
    """
    reference = load_turbine(name)
    model = replace(load_turbine(path), control=reference.control)
    (found, pitch), (wanted, expected) = operation(model, wind), operation(reference, wind)
    np.testing.assert_allclose(found, wanted, rtol=0.01)
    assert pitch == pytest.approx(expected, rel=0.01, abs=np.radians(0.1))
