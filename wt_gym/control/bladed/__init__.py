"""Controllers compiled as libraries with the Bladed interface (DISCON), among them ROSCO."""

import wt_gym.control.controllers  # noqa: F401  # its catalogue and this room need each other: it must come first
from wt_gym.control.bladed.controller import BladedController
from wt_gym.control.bladed.records import RECORDS, Record
from wt_gym.control.bladed.rosco import RoscoController, rosco_library

__all__ = ["RECORDS", "BladedController", "Record", "RoscoController", "rosco_library"]
