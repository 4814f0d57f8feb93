"""What all tests share."""

import pytest

from wt_gym.bridges.compiler import CompilerError, find_compiler
from wt_gym.envs import running_record


@pytest.fixture(scope="session", autouse=True)
def short_records():
    """Let the running turbine, from which episodes begin, be recorded for seconds: tests of it ask for what they need.

    Processes that a test starts record it in full.
    """
    full = running_record.RECORDING_PLAN
    running_record.RECORDING_PLAN = running_record.RecordingPlan(runs=1, settling=10.0, recorded=20.0)
    yield full
    running_record.RECORDING_PLAN = full


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
    from wt_gym.agents.export.discon import export_discon

    made = {}

    def export(choice, turbine="nrel_5mw", **options):
        key = choice, turbine, tuple(options.items())
        if key not in made:
            folder = tmp_path_factory.mktemp("exported")
            made[key] = export_discon(choice, folder, turbine=turbine, interval=INTERVAL, **options)["files"]
        return made[key]

    return export
