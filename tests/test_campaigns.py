"""A small share of `make fuzz` and `make kill`."""

import pytest
from campaigns import fuzz, kill


def test_no_damaged_input_escapes():
    doors = list(fuzz.DOORS)
    finds, tried = fuzz.campaign(20 * len(doors), seed=0, doors=doors)
    assert not finds, "\n".join(finds)
    assert set(tried.values()) == {20}


def test_an_escape_is_a_find(monkeypatch):
    def door(folder, rng):
        if rng.random() < 0.5:
            raise KeyError("escaped")

    monkeypatch.setitem(fuzz.DOORS, "door", door)
    finds, _ = fuzz.campaign(20, seed=0, doors=["door"])
    assert 0 < len(finds) < 20
    assert all(f.startswith("--door door --seed ") and "KeyError" in f for f in finds)
    again = int(finds[0].split()[3])
    assert "escaped" in fuzz.try_input(door, again)


@pytest.mark.slow
def test_killed_jobs_go_on_to_the_same_bits():
    done, finds = kill.campaign(2, seed=0, names=["evaluation"])
    assert done >= 2 and not finds, finds
