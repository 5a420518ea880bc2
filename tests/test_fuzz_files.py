"""Damaged files: 2,000 mutants of the shipped ones are accepted or refused, never crashed on."""

from collections import Counter

import pytest
from mutations import Remembered, bases, judged, mutant

COUNT, PARTS = 2000, 8


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("mutants")


@pytest.fixture(scope="module")
def shipped():
    return bases()


@pytest.fixture(scope="module", autouse=True)
def remembered():
    with pytest.MonkeyPatch.context() as patch:
        Remembered(patch)
        yield


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("part", range(PARTS))
def test_a_damaged_file_is_sound_or_refused_and_harm_is_named_on_its_line(part, shipped, folder):
    verdicts = [judged(mutant(shipped, seed), folder) for seed in range(part, COUNT, PARTS)]
    crashed = [(v.mutant.base.name, v.mutant.kind, v.mutant.path, v.lines) for v in verdicts if v.code not in (0, 3)]
    assert crashed == []
    assert all(len(v.lines) <= 6 and not any("\n" in line for line in v.lines) for v in verdicts)
    harmful = [v for v in verdicts if v.mutant.harmful]
    missed = Counter((v.mutant.kind, v.code) for v in harmful if not v.named)
    assert len(harmful) > 50 and sum(missed.values()) <= 0.1 * len(harmful), missed


def test_the_shipped_files_themselves_are_sound_when_written_anew(shipped, folder):
    from mutations import Mutant, written

    for path, data in shipped.items():
        verdict = judged(Mutant(path, "none", written(data)[0].encode(), (), 1, 1, False), folder)
        assert verdict.code == 0, (path, verdict.lines)
