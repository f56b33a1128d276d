"""The stages whose time is told are there under the names by which they are found."""

from benchmarks.localizer_times import STAGES


def test_every_stage_is_a_function_of_its_owner():
    assert [name for name, (owner, function) in STAGES.items() if function not in vars(owner)] == []
