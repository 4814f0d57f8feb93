"""What all tests share."""

import pytest

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
