"""Fuzzing of the environment: drawn winds, turbines, arguments and policies, with its contract checked in each step."""

from wt_gym.agents.fuzzing.cases import POLICY_NAMES, WINDS, FuzzCase, draw_case
from wt_gym.agents.fuzzing.contract import Contract, ContractBroken
from wt_gym.agents.fuzzing.memory import MemoryRecord, measure_memory
from wt_gym.agents.fuzzing.run import CaseResult, Finding, fuzz, run_case

__all__ = [
    "POLICY_NAMES",
    "WINDS",
    "CaseResult",
    "Contract",
    "ContractBroken",
    "Finding",
    "FuzzCase",
    "MemoryRecord",
    "draw_case",
    "fuzz",
    "measure_memory",
    "run_case",
]
