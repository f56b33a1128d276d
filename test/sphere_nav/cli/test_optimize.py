"""Published optima of pose graphs, in GTSAM's chi2 with full information and in SE-Sync's cost."""

import json
from pathlib import Path

import pytest

from sphere_nav.cli.main import main

DATA = Path(__file__).parents[2] / ".." / "shared" / "data" / "pose_graphs"
OPTIMA = {  # chi2 where it is published, cost of SE-Sync
    "tinyGrid3D": (18.628, 18.520),
    "smallGrid3D": (1035.85, 1025.50),
    "sphere2500": (1351.40, 1687.0),
    "parking-garage": (1.26839, 1.2625),
    "intel": (None, 52.35),
    "manhattan": (None, 6431.4),
}


@pytest.mark.parametrize("name", OPTIMA)
@pytest.mark.skipif(not DATA.is_dir(), reason=f"recorded pose graphs are not in {DATA}")
def test_published_optima_are_reached_within_a_thousandth(name, tmp_path):
    report = tmp_path / "report.json"
    assert main(["optimize", str(DATA / f"{name}.g2o"), "-o", str(tmp_path / "out.g2o"), "--json", str(report)]) == 0
    found, (chi2, cost) = json.loads(report.read_text()), OPTIMA[name]
    assert found["chordal_cost"] == pytest.approx(cost, rel=1e-3)
    assert chi2 is None or found["chi2_after"] == pytest.approx(chi2, rel=1e-3)
    assert found["is_certified"]
    assert found["doubt"] == ""


def triangle(path, extra=()):
    edges = ["EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1", "EDGE_SE2 1 2 1 0 2.0944 1 0 0 1 0 1", "EDGE_SE2 0 2 2 0 2 1 0 0 1 0 1"]
    path.write_text("\n".join([*edges, *extra]) + "\n")
    return path


def test_it_prints_chi2_and_writes_a_graph_that_is_at_its_optimum(tmp_path, capsys):
    graph, out = triangle(tmp_path / "graph.g2o"), tmp_path / "out.g2o"
    assert main(["optimize", str(graph), "-o", str(out), "--json", str(tmp_path / "a.json")]) == 0
    told = capsys.readouterr().out
    assert all(f"{word}: " in told for word in ("chi2_before", "chi2_after", "iterations"))
    assert main(["optimize", str(out), "-o", str(tmp_path / "again.g2o"), "--json", str(tmp_path / "b.json")]) == 0
    first, again = (json.loads((tmp_path / f"{name}.json").read_text()) for name in "ab")
    assert first["chi2_after"] < first["chi2_before"]
    assert again["chi2_before"] == pytest.approx(first["chi2_after"], rel=1e-6)


def test_misuse_is_told_in_one_line(tmp_path, capsys):
    graph = triangle(tmp_path / "graph.g2o", ["EDGE_SE2 0 3 1"])
    assert main(["optimize", str(graph), "-o", str(tmp_path / "out.g2o")]) == 2
    assert "graph.g2o:4: EDGE_SE2: expected 11 numbers, found 3" in capsys.readouterr().err
    assert not (tmp_path / "out.g2o").exists()
    triangle(graph)
    before = graph.read_text()
    assert main(["optimize", str(graph), "-o", str(graph)]) == 2
    assert "expected another file than the graph" in capsys.readouterr().err
    assert graph.read_text() == before
