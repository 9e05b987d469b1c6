"""Images in threads: in order, with the first fault, and never with more memory than there may be."""

from __future__ import annotations

from threading import Barrier, Lock

import pytest

from mbm.data.images import together


@pytest.fixture(autouse=True)
def four_processors(monkeypatch):
    monkeypatch.setattr(together.os, "cpu_count", lambda: 4)


def test_results_are_in_the_order_of_the_items():
    barrier = Barrier(2)

    def work(item):
        if item < 2:
            barrier.wait(10)  # the first two are at work at the same time, or this raises
        return 10 * item

    assert together.in_threads(work, range(20)) == [10 * item for item in range(20)]
    assert together.in_threads(work, []) == []


def test_the_first_fault_is_raised():
    def work(item):
        if item >= 3:
            raise ValueError(item)
        return item

    with pytest.raises(ValueError, match=r"^3$"):
        together.in_threads(work, range(8))


def test_images_share_the_memory(monkeypatch):
    monkeypatch.setenv("MBM_MEMORY", "100B")
    room, lock, at_work, most = together.Room(), Lock(), [], []

    def work(needed):
        with room.of(needed):
            with lock:
                at_work.append(needed)
                most.append(sum(at_work))
            with lock:
                at_work.remove(needed)
        return needed

    needs = [60, 30, 60, 30, 100, 10, 90] * 20
    assert together.in_threads(work, needs) == needs
    assert max(most) <= 100
