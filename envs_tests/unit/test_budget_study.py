"""Arithmetic of the study of budgets, on results that are written here."""

import budget_study as study
import pytest
from study_pages import filled

HEAD = {"limits": study.LIMITS}


def result(episode, violated=(), kind="none", **changes):
    """Result of an episode."""
    values = {
        "episode": episode, "kind": kind, "wind": 15.0, "steps": 300, "ending": "time", "violated": list(violated),
        "speed": 1.05, "clearance": 7.0, "acceleration": 0.4, "travel": 3000.0, "flap": 5.0, "power": 5.0,
        "filtered": 0.0,
    }  # fmt: skip
    return values | changes


def found():
    """Four episodes; it violates limits in the last two, once with its base controller."""
    agent = [
        result(0),
        result(1, kind="slow_drive", travel=5000.0),
        result(2, ["rotor_speed"], "slow_drive", speed=1.2, ending="overspeed", steps=100),
        result(3, ["rotor_speed", "tip_clearance"], clearance=1.0),
    ]
    base = [result(0), result(1, kind="slow_drive"), result(2, ["rotor_speed"], "slow_drive"), result(3)]
    filtered = [result(0), result(1, kind="slow_drive", filtered=0.5, steps=100), *base[2:]]
    rows = {study.PLAIN: agent, study.BASE: base, study.FILTERED: filtered, study.TASK: base}
    return {policy: {row["episode"]: row for row in many} for policy, many in rows.items()}


def test_violations_are_counted_by_limit_and_kind_and_beside_the_base_controller():
    several = found()
    several[study.PLAIN][4] = result(4)  # of the agent alone
    several[study.PLAIN][6] = result(6, ["rotor_speed"])  # behind a gap
    sums = study.summary(several, HEAD)
    assert (sums["episodes"], sums["paired"]) == (5, 4)
    agent = sums["agent"]
    assert (agent["episodes"], agent["any"], agent["ended"]) == (5, 2, 1)
    assert agent["limits"] == {"pitch_travel": 0, "rotor_speed": 2, "tip_clearance": 1, "tower_acceleration": 0}
    assert agent["most"] == {
        "pitch_travel": 5000.0, "rotor_speed": 1.2, "tip_clearance": 1.0, "tower_acceleration": 0.4
    }  # fmt: skip
    assert {kind: one["any"] for kind, one in sums["kinds"].items()} == {"none": 1, "slow_drive": 1}
    assert [(row["episode"], bool(row["base"])) for row in sums["beyond"]] == [(2, True), (3, False)]
    counts = {policy: one["any"] for policy, one in sums["paired_counts"].items()}
    assert counts == {"task": 1, "base": 1, "agent": 2, "filtered": 1}
    # by steps, not by episodes: 50 of 700
    assert sums["filtered"] == {"none": 0.0, "slow_drive": pytest.approx(50 / 400)}
    assert sums["paired_counts"]["filtered"]["filtered"] == pytest.approx(50 / 1000, rel=1e-3)


def test_what_the_agent_adds_is_what_its_base_controller_does_not_violate_too():
    """Also where it was not played yet."""
    several = found()
    assert study.added(study.summary(several, HEAD)) == 1
    several[study.PLAIN][4] = result(4, ["rotor_speed"])
    sums = study.summary(several, HEAD)
    assert study.added(sums) == 2
    row = "| any, and none seen under the base controller | 2 (400 ‰, 53 to 853 ‰) | – | – | – | – |"
    assert row in study.tables(sums).splitlines()


def test_shares_have_exact_intervals():
    """Of Clopper and Pearson."""
    assert study.share(30, 1000) == "30 (30 ‰, 20 to 43 ‰)"
    assert study.share(3, 1000) == "3 (3 ‰, 0.62 to 8.7 ‰)"
    assert study.share(0, 1000) == "0 (0 ‰, 0 to 3.7 ‰)"


def test_the_page_has_the_tables_of_the_record():
    text, tables = study.PAGE.read_text(encoding="utf-8"), study.tables(study.record_of(None))
    assert filled(text, {"budget study": lambda _: tables}) == text


def test_a_run_goes_on_where_it_ended_and_refuses_other_results(tmp_path, monkeypatch):
    """Base controller and filter play the first episodes and those with a violation."""
    calls = []

    def play(policy, agent, episode):
        calls.append((policy, episode))
        return result(episode, ["rotor_speed"] if episode == 21 and policy == "agent" else ())

    monkeypatch.setattr(study, "play", play)
    monkeypatch.setattr(study, "setup", lambda agent: HEAD | {"model": str(agent)})
    study.run(tmp_path, "one", episodes=3, paired=2, jobs=1)
    assert calls[:3] == [("agent", 0), ("agent", 1), ("agent", 2)]
    assert calls[3:] == [(policy, k) for policy in ("base", "filtered", "task") for k in (0, 1)]
    calls.clear()
    path = tmp_path / "agent.jsonl"
    path.write_text(path.read_text()[:-20])  # cut off while the third was written
    study.run(tmp_path, "one", episodes=22, paired=2, jobs=1)
    assert [k for policy, k in calls if policy == "agent"] == list(range(2, 22))
    assert [one for one in calls if one[0] != "agent"] == [("base", 21), ("filtered", 21)]
    assert study.record_of(tmp_path)["beyond"][0] == {
        "episode": 21, "kind": "none", "wind": 15.0, "violated": ["rotor_speed"], "ending": "time", "base": [],
        "filtered": [], "acceleration": {"agent": 0.4, "base": 0.4, "filtered": 0.4},
    }  # fmt: skip
    with pytest.raises(ValueError, match="have another model: give --out another folder"):
        study.run(tmp_path, "two", episodes=3, paired=2, jobs=1)
