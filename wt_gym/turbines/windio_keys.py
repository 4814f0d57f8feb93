"""Keys and values of a windIO file against windIO's schema: foreign keys are left aside, wrong values are refused.

The schema is a list of what windIO knows. What it does not know belongs to another tool, or is a typing error: it is
taken out and named in a note, with the known key that it resembles. Values are held against the schema only in the
parts that a turbine is built from, so that a flaw in the composite layers does not cost the turbine. Which keys a
turbine cannot do without is for its readers to say.
"""

import difflib
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from wt_gym.base.errors import TurbineDefinitionError

__all__ = ["ForeignKeys", "check_values", "take_out_foreign_keys"]

SCHEMA = "turbine/turbine_schema.yaml"

_ADDED = {
    "components": ("RNA",),
    "components.blade.structure.elastic_properties.structural_damping": ("damping_ratio",),
    "components.tower.structure.elastic_properties.structural_damping": ("damping_ratio",),
    "components.drivetrain.elastic_properties": ("spring_constant", "damping_coefficient", "inertia_tt"),
    "components.yaw.elastic_properties": ("spring_constant", "damping_coefficient"),
}
"""Keys that this package reads in addition to the schema's, by their parent's path."""

_UNCHECKED = (
    "airfoils",  # thousands of numbers, which their reader checks one by one
    "comments",
    "components.blade.outer_shape.surface",
    "components.blade.structure",
    "components.floating_platform",
    "components.jacket",
    "components.monopile",
    "components.mooring",
    "components.drivetrain.bedplate",
    "components.drivetrain.hss",
    "components.drivetrain.nose",
    "components.drivetrain.other_components",
    "materials",
    "outputs",
)
"""Parts whose values are not held against the schema: nothing is built from them, or their reader checks them."""

_ALIKE = 0.8
"""Likeness of two keys, from 0 to 1, from which one is taken for a typing error of the other."""


@dataclass
class ForeignKeys:
    """Keys that windIO does not know.

    Attributes
    ----------
    by_parent : dict
        Key path of the mapping (``[*]`` for any entry of a list) and the foreign keys in it.
    resembling : dict
        Key path that windIO knows and the file lacks, and the foreign key beside it that resembles it.
    """

    by_parent: dict[str, list[str]] = field(default_factory=dict)
    resembling: dict[str, str] = field(default_factory=dict)

    def notes(self) -> list[str]:
        """Return a sentence for every mapping with foreign keys."""
        sentences = []
        for parent, keys in self.by_parent.items():
            where = parent or "top level"
            found = {known.removeprefix(f"{parent}.") if parent else known: key
                     for known, key in self.resembling.items() if known.rpartition(".")[0] == parent}  # fmt: skip
            alike = "".join(f"; {key} resembles {known}, which is missing" for known, key in found.items())
            sentences.append(f"{where}: keys that windIO does not know are left aside: {', '.join(keys)}{alike}")
        return sentences


def take_out_foreign_keys(data: dict[str, Any]) -> ForeignKeys:
    """Remove the keys that windIO's schema does not know from the content of a file, in place.

    Parameters
    ----------
    data : dict

    Returns
    -------
    ForeignKeys
    """
    found = ForeignKeys()
    _scan(data, _schema(), "", found)
    return found


def check_values(data: dict[str, Any]) -> None:
    """Hold the values of the parts that a turbine is built from against windIO's schema.

    Raises
    ------
    TurbineDefinitionError
        Naming the key path of the first violation; further ones are counted.
    """
    from jsonschema import Draft7Validator

    checked = _without(data, "")
    errors = sorted(Draft7Validator(_optional(_schema())).iter_errors(checked), key=lambda error: error.json_path)
    if not errors:
        return
    path, message = errors[0].json_path.removeprefix("$").lstrip("."), errors[0].message
    if len(message) > 300:
        # The offending value comes first and may be a whole table; what is allowed stands at the end.
        message = f"{message[:100]} ... {message[-180:]}"
    more = f" (and {len(errors) - 1} more violations of the schema)" if len(errors) > 1 else ""
    raise TurbineDefinitionError(f"{path or 'top level'}: {message}{more}")


@cache
def _schema() -> dict[str, Any]:
    # windIO pulls in xarray and netCDF4, most of a second: only those who read a new file pay for it.
    import windIO
    from windIO.schemas import schemaPath

    out: dict[str, Any] = windIO.load_yaml(schemaPath / SCHEMA)
    return out


def _optional(schema: Any) -> Any:
    """Return a schema that requires no keys, without its name, by which references would be looked up elsewhere."""
    if isinstance(schema, dict):
        return {
            key: _optional(value)
            for key, value in schema.items()
            if not (key == "required" and isinstance(value, list)) and key != "$id"
        }
    return [_optional(value) for value in schema] if isinstance(schema, list) else schema


def _without(value: Any, path: str) -> Any:
    """Return a copy of the nested mappings without the parts that are not checked and without empty entries."""
    if not isinstance(value, dict):
        return value
    places = {key: f"{path}.{key}" if path else str(key) for key in value}
    return {
        key: _without(entry, places[key])
        for key, entry in value.items()
        if places[key] not in _UNCHECKED and entry is not None
    }


def _alternatives(schema: Any) -> list[dict[str, Any]]:
    """Return the schemas that describe a value: the one given, or the alternatives that it names."""
    if not isinstance(schema, dict):
        return []
    if "$ref" in schema:
        target: Any = _schema()
        for part in schema["$ref"].removeprefix("#/").split("/"):
            target = target[part]
        return _alternatives(target)
    found = [schema] if "properties" in schema or "items" in schema else []
    for key in ("oneOf", "anyOf", "allOf"):
        for option in schema.get(key, ()):
            found += _alternatives(option)
    return found


def _scan(value: Any, schema: Any, path: str, found: ForeignKeys) -> None:
    options = _alternatives(schema)
    if isinstance(value, list):
        items = [option["items"] for option in options if isinstance(option.get("items"), dict)]
        if items and any(isinstance(entry, (dict, list)) for entry in value):
            for entry in value:
                _scan(entry, {"anyOf": items}, f"{path}[*]", found)
        return
    known: dict[str, list[Any]] = {}
    # Where windIO admits keys of others, they stay unnamed unless they look like typing errors.
    open_to_others = any(option.get("additionalProperties") is True for option in options)
    for option in options:
        for key, part in option.get("properties", {}).items():
            known.setdefault(key, []).append(part)
    if not isinstance(value, dict) or not known:
        return
    for key in _ADDED.get(path, ()):
        known[key] = [{}]
    foreign = [key for key in value if key not in known]
    for key in foreign:
        missing = [name for name in known if value.get(name) is None]
        alike = difflib.get_close_matches(str(key), missing, 1, _ALIKE)
        for name in alike:
            found.resembling[f"{path}.{name}" if path else name] = str(key)
        if alike or not open_to_others:
            keys = found.by_parent.setdefault(path, [])
            if str(key) not in keys:
                keys.append(str(key))
        del value[key]
    for key, entry in value.items():
        _scan(entry, {"anyOf": known[key]}, f"{path}.{key}" if path else str(key), found)
