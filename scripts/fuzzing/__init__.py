"""Fuzzing of the environment: drawn winds, turbines, arguments and policies, with its contract checked in each step."""

from fuzzing.cases import POLICY_NAMES, WINDS, FuzzCase, draw_case
from fuzzing.contract import Contract, ContractBroken
from fuzzing.memory import MemoryRecord, measure_memory
from fuzzing.run import CaseResult, Finding, fuzz, run_case

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
