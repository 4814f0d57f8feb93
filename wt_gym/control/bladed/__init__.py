"""Controllers compiled as libraries with the Bladed interface (DISCON), among them ROSCO."""

from wt_gym.control.bladed.controller import BladedController
from wt_gym.control.bladed.records import RECORDS, Record
from wt_gym.control.bladed.rosco import RoscoController, rosco_library

__all__ = ["RECORDS", "BladedController", "Record", "RoscoController", "rosco_library"]
