"""What all tests share."""

import pytest

from wt_gym.base.errors import forget_warnings
from wt_gym.bridges.compiler import CompilerError, find_compiler
from wt_gym.turbines import load_turbine


@pytest.fixture(autouse=True)
def fresh_warnings():
    """Give in each test the warnings that a process gives once."""
    forget_warnings()


@pytest.fixture(scope="session")
def turbine():
    """The NREL 5-MW."""
    return load_turbine("nrel_5mw")


@pytest.fixture
def scripted(monkeypatch):
    """Environments of this process have a simulator of swinging loads: what counts is the interface, no physics."""
    from envs_tests.env.scripted_simulator import Swinging, use

    use(monkeypatch, Swinging)


@pytest.fixture(scope="module")
def scripted_module():
    """As `scripted`, for all tests and fixtures of a module."""
    from envs_tests.env.scripted_simulator import Swinging, use

    with pytest.MonkeyPatch.context() as patch:
        use(patch, Swinging)
        yield


MINE = """
import numpy as np
from wt_gym.control import Demand
from wt_gym.control.controllers import make_controller

class Hold:
    channels = ("generator_speed",)
    def __init__(self, gain=1.0):
        self.gain = gain
    def start(self, signals, demand):
        self.demand = demand
    def step(self, signals, dt):
        return self.demand

class Sized(Hold):
    def __init__(self, turbine, gain=1.0):
        super().__init__(gain)
        self.radius = turbine.rotor_diameter / 2

class More:
    channels = ()
    def start(self, signals):
        pass
    def step(self, signals, dt, demand):
        return demand

class Rests:
    env_kwargs = {"action_mode": "absolute", "residual_form": "rate", "observation": ["rotor"]}
    def __init__(self, layout, offset=0.0):
        self.size, self.offset = layout.action.size, offset
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(self.size, self.offset, dtype=np.float32), state

class Cheats(Rests):
    env_kwargs = {"turbine": "iea_15mw"}

def retuned(turbine, gain_factor=1.0):
    return make_controller("retuned", turbine, gain_factor=gain_factor)

NOTHING = 3
"""


@pytest.fixture
def mine(tmp_path):
    """Path of a module with controllers and agents of one's own."""
    path = tmp_path / "mine.py"
    path.write_text(MINE)
    return path


@pytest.fixture(scope="session")
def compiler():
    """Skip what needs a C compiler where there is none."""
    try:
        find_compiler()
    except CompilerError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def exported(tmp_path_factory, compiler):
    """Exports of controllers by name, turbine and options, each made once."""
    from envs_tests.unit.exported_library import INTERVAL  # with PyTorch, for tests that ask for it
    from wt_gym.deployment.export.discon import export_discon

    made = {}

    def export(choice, turbine="nrel_5mw", **options):
        key = choice, turbine, tuple(options.items())
        if key not in made:
            folder = tmp_path_factory.mktemp("exported")
            made[key] = export_discon(choice, folder, turbine=turbine, interval=INTERVAL, **options)["files"]
        return made[key]

    return export
