"""What a long run says of samples: growth by the hour under outliers and a cut last line, descriptors, threads."""

import json

import pytest

from benchmarks.abuse.soak import judge

HOUR, STEP = 3600, 30  # s


def sample(seconds, growth_kb_per_hour, threads):
    spike = 50_000 * (seconds % 300 == 0)  # kB: the process was in the middle of something
    anonymous = 10_000 + int(growth_kb_per_hour * seconds / HOUR) + spike
    looks = {"node": {"anonymous": anonymous, "handles": 20, "threads": threads, "cpu": 0.1 * seconds}}
    return {"time": seconds, "looks": looks, "shared_bytes": 100, "way": 0.0, "reason": ""}


@pytest.mark.parametrize(
    ("growth", "threads", "is_met"), [(0, 0, True), (512, 0, True), (4096, 0, False), (0, 1, False)]
)
def test_growth_is_found_under_spikes_and_in_a_run_that_was_cut_off(tmp_path, growth, threads, is_met):
    lines = [json.dumps(sample(at, growth, 5 + threads * (at > 2000))) for at in range(0, HOUR, STEP)]
    log = tmp_path / "soak.jsonl"
    log.write_text("\n".join([*lines, lines[0][:50]]), encoding="utf-8")
    report = judge(log)
    memory = next(bound for bound in report.bounds if "memory" in bound.what)
    assert memory.measured == pytest.approx(growth / 1024, abs=0.02)
    assert all(bound.is_met for bound in report.bounds) == is_met
    assert report.tables[0].rows[0][-1] == "10.0"  # per cent of a core
