"""Programmes of segments: what is refused, how they travel as JSON, and that keys of stored runs stay."""

import dataclasses

import pytest

from rso.contract import Case, Programme, Segment, beyond_control, digest, run_key

PRESS, REST = Segment("force", rate=0.1, to_N=0.2), Segment("force", hold_s=10.0, asked_s=(1.0, 10.0))


@pytest.mark.parametrize(
    ("stated", "why"),
    [
        ({"control": "depth", "rate": 1.0, "to_mm": 1.0}, "control = 'depth': choose from travel, force"),
        ({"control": "force", "rate": 1.0}, "one of to_mm, to_N .* or hold_s"),
        ({"control": "force", "rate": 1.0, "to_N": 1.0, "to_mm": 1.0}, "one of to_mm, to_N"),
        ({"control": "force", "rate": 1.0, "to_mm": 1.0}, 'control = "force" ends at a force, to_N'),
        ({"control": "force", "rate": -1.0, "to_N": 1.0}, "rate = -1.0 N/s: a positive rate"),
        ({"control": "travel", "to_mm": 1.0}, "rate = None mm/s: a positive rate"),
        ({"control": "force", "hold_s": 0.0}, "hold_s = 0 s"),
        ({"control": "force", "hold_s": 1.0, "rate": 1.0}, "a rest has no rate"),
        ({"control": "force", "hold_s": 1.0, "asked_s": (0.5, 2.0)}, "at most hold_s = 1 s"),
        ({"control": "force", "hold_s": 1.0, "asked_s": (0.5, 0.5)}, "in increasing order"),
        ({"control": "travel", "rate": float("nan"), "to_mm": 1.0}, "rate = nan: a finite number"),
        ({"control": "travel", "rate": "1", "to_mm": 1.0}, "rate = '1': a number is expected"),
    ],
)
def test_a_segment_that_is_none_names_key_value_and_choices(stated, why):
    with pytest.raises(ValueError, match=why):
        Segment(**stated)


@pytest.mark.parametrize(
    ("stated", "why"),
    [
        ({"segments": (PRESS,)}, "nothing is asked for"),
        ({"segments": (PRESS,), "asked_N": (0.2, 0.1)}, "asked_N must increase"),
        ({"segments": (PRESS,), "asked_N": (0.1,), "time_s": (0.0, 1.0), "travel_mm": (0.0, 1.0)}, "stand alone"),
        ({"segments": (REST,)}, r"segments\[0\]: a rest at a force comes after"),
        ({"segments": (PRESS, PRESS), "asked_N": (0.1,)}, r"segments\[1\]: it ends at 0.2 N, where it begins"),
        ({"segments": (PRESS, REST), "asked_s": (13.0,)}, r"within \(0, 12\] s"),
        (
            {"segments": (Segment("travel", rate=1.0, to_N=0.1), REST), "asked_s": (1.0,)},
            "known only after the run",
        ),
        ({"segments": (dataclasses.replace(PRESS, asked_s=(3.0,)),)}, "at most 2 s, how long it lasts"),
    ],
)
def test_segments_that_cannot_follow_each_other_are_refused(stated, why):
    with pytest.raises(ValueError, match=why):
        Programme(**stated)


def test_a_programme_of_segments_survives_the_way_through_json():
    travel = Segment("travel", rate=0.5, to_N=0.05)
    programme = Programme(segments=(travel, PRESS, REST), asked_N=(0.1,), asked_mm=(0.5,))
    data = Case("case", programme, {"radius": 3.0}).to_json()
    assert Case.from_json(data).programme == programme
    assert data["programme"]["segments"][0] == {"control": "travel", "rate": 0.5, "to_N": 0.05}
    waypoints = Case("case", Programme.ramp((1.0,)), {}).to_json()["programme"]
    assert sorted(waypoints) == ["asked_mm", "asked_s", "time_s", "travel_mm"]  # what programs of others know


@pytest.mark.parametrize(
    ("programme", "why"),
    [
        ({"segments": {}}, "case.programme.segments = {}: a list of tables"),
        ({"segments": [{"rate": 1.0}]}, r"case.programme.segments\[0\].control: missing; choose from travel, force"),
        ({"segments": [{"control": "force", "load": 1.0}]}, r"segments\[0\].load: unknown; choose from control, rate"),
        ({"segments": [{"control": "force", "hold_s": "1 s"}]}, r"segments\[0\].hold_s = '1 s': a number"),
        ({"segments": [], "speed": 1.0}, "unknown: \\['speed'\\]"),
        ({"asked_mm": [1.0]}, "needs time_s and travel_mm, or segments"),
    ],
)
def test_a_request_that_is_wrong_is_told_where(programme, why):
    with pytest.raises(ValueError, match=why):
        Case.from_json({"name": "case", "programme": programme, "settings": {}})


class Toy:
    """What a run key asks of a backend."""

    name, numerics = "toy", 1


def test_keys_of_programmes_of_travel_are_those_of_before():
    """The hash as the key was made when a programme had four fields, of which empty ones were left out."""
    for programme in (Programme.ramp((0.5, 1.0)), Programme((0.0, 2.0, 9.0), (0.0, 1.0, 1.0), (1.0,), (4.0, 9.0))):
        parts = ("time_s", "travel_mm", "asked_mm", "asked_s")
        before = {k: list(v) for k in parts if (v := getattr(programme, k)) != ()}
        whole = {"backend": "toy", "numerics": 1, "values": {}, "programme": before, "settings": {}, "artefacts": {}}
        assert run_key(Toy(), {}, Case("c", programme, {})) == digest(whole)


def test_keys_tell_segments_apart():
    one = Programme(segments=(PRESS, REST))
    other = Programme(segments=(PRESS, dataclasses.replace(REST, hold_s=11.0)))
    again = Programme(segments=(Segment("force", rate=0.1, to_N=0.2), REST))
    keys = [run_key(Toy(), {}, Case("c", p, {})) for p in (one, other, again)]
    assert keys[0] == keys[2] != keys[1]


def test_a_backend_that_knows_travel_alone_refuses_a_force():
    class Knows(Toy):
        def controls_force(self, settings):
            return settings.get("radius", 0.0) > 0.0

    forced, plain = (Case("c", p, {"radius": 1.0}) for p in (Programme(segments=(PRESS, REST)), Programme.ramp((1.0,))))
    assert beyond_control(Toy(), plain) is None and beyond_control(Knows(), forced) is None
    assert "The backend 'toy' does not understand" in beyond_control(Toy(), forced)
    assert beyond_control(Knows(), dataclasses.replace(forced, settings={})) is not None
