"""What all tests share."""

import pytest

from wt_gym.base.errors import forget_warnings
from wt_gym.bridges.compiler import CompilerError, find_compiler


@pytest.fixture(autouse=True)
def fresh_warnings():
    """Give in each test the warnings that a process gives once."""
    forget_warnings()


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
