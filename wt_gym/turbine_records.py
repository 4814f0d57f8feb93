"""Turbines of the catalog: one record each, a file ``turbines/records/NAME.json``.

This module loads nothing heavy: the ids of the environments are registered from it. A new turbine of the catalog is a
new record.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "turbines" / "records"
"""Of the records."""


@dataclass(frozen=True)
class TurbineRecord:
    """What the package knows of a turbine by name.

    Attributes
    ----------
    name : str
        Of ``load_turbine`` and of the file of the record.
    source : dict
        Where the turbine comes from, one of ``{"file": a windIO file in turbines/data}``, ``{"windio_example": one that
        comes with windIO}``, ``{"function": "module:function" that makes it}`` and ``{"turbine": another name,
        "water_depth": [m]}``, that turbine on the monopile of its file.
    label : str, optional
        ``wt_gym/<label>-Steady-v<version>`` and ``wt_gym/<label>-Turbulent-v<version>`` are ids of environments; None:
        there are none.
    version : int, optional
    arguments : dict
        Of environments with this turbine, where the defaults do not fit it.
    region_2_gain_factor : float, optional
        Multiple of the published gain below rated that made the most power in coupled runs
        (`wt_gym.control.controllers.own`).
    rotor_table : dict, optional
        Coefficients of the rotor as measured in the simulator (`wt_gym.control.rotor`), or ``{"turbine": its name,
        "same_as": another name}`` for those of another turbine with the same rotor.
    """

    name: str
    source: dict[str, Any]
    label: str | None = None
    version: int | None = None
    arguments: dict[str, Any] = field(default_factory=dict)
    region_2_gain_factor: float | None = None
    rotor_table: dict[str, Any] | None = None

    @property
    def ids(self) -> tuple[tuple[str, dict[str, Any]], ...]:
        """Ids with the arguments of their environments."""
        inflows = () if self.label is None else ("Steady", "Turbulent")
        return tuple(
            (
                f"wt_gym/{self.label}-{inflow}-v{self.version}",
                {"turbine": self.name, "inflow": inflow.lower(), **self.arguments},
            )
            for inflow in inflows
        )


def read_records(folder: Path) -> dict[str, TurbineRecord]:
    """Read the records of a folder, by name in alphabetical order.

    Raises
    ------
    ValueError
        If a file holds no record.
    """
    found = {}
    for path in sorted(folder.glob("*.json")):
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            given = content.pop("arguments", {})
            arguments = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}
            record = TurbineRecord(path.stem, **content, arguments=arguments)
        except (ValueError, TypeError, AttributeError) as error:
            raise ValueError(f"{path} must hold the record of a turbine, see TurbineRecord: {error}") from error
        if len(record.source.keys() & {"file", "windio_example", "function", "turbine"}) != 1:
            raise ValueError(
                f"{path}: source must have one of file, windio_example, function and turbine, got {record.source}"
            )
        if (record.label is None) != (record.version is None):
            raise ValueError(f"{path}: label and version must both be given or both be left out")
        found[path.stem] = record
    return found


RECORDS = read_records(FOLDER)
"""Record of every turbine of the catalog by its name."""
