"""Options that come later leave what was recorded before them as it is."""

from dataclasses import make_dataclass

from wt_gym.base.fields import later_field
from wt_gym.simulation.contract import fingerprint

EARLIER = make_dataclass("Options", [("rows", int)])
LATER = make_dataclass("Options", [("rows", int), ("gain", float, later_field(10.0))])


def test_a_later_field_at_its_default_leaves_the_fingerprint():
    assert fingerprint(LATER(3)) == fingerprint(EARLIER(3))
    assert fingerprint(LATER(4)) != fingerprint(EARLIER(3))


def test_a_later_field_with_another_value_changes_it():
    assert fingerprint(LATER(3, 11.0)) != fingerprint(LATER(3))
