"""Published optima of pose graphs, in GTSAM's chi2 with full information and in SE-Sync's cost."""

import json
from pathlib import Path

import pytest

from sphere_nav_tools.cli.main import main

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


def square(path, extra=()):
    """A drive four times around a square of 5 m in the plane, each corner joined to the one of the round before."""
    edges = [f"EDGE_SE2 {k} {k + 1} 5 0 {1.5708 + 0.002 * (k % 3)} 100 0 0 100 0 400" for k in range(15)]
    edges += [f"EDGE_SE2 {k} {k + 4} 0 0 0 100 0 0 100 0 400" for k in range(12)]
    path.write_text("\n".join([*edges, *extra]) + "\n")
    return path


def test_false_loops_are_left_out_on_request_and_named(tmp_path, capsys):
    graph = square(tmp_path / "graph.g2o", ["EDGE_SE2 2 12 5 5 1 100 0 0 100 0 400"])
    out, table, report = (tmp_path / name for name in ("out.g2o", "false.csv", "report.json"))
    command = ["optimize", str(graph), "-o", str(out), "--json", str(report)]
    assert main([*command, "--robust", "--outliers", str(table)]) == 0
    assert "outliers: 1 of 13 loops" in capsys.readouterr().out
    head, row = table.read_text().splitlines()
    assert (head, row.split(",")[:3]) == ("line,a,b,chi2", ["28", "2", "12"])
    found = json.loads(report.read_text())
    assert found["outliers"] == [[2, 12]]
    assert found["chi2_with_outliers"] == pytest.approx(found["chi2_after"] + float(row.split(",")[3]), rel=1e-6)
    assert "EDGE_SE2 2 12 " not in out.read_text()
    assert out.read_text().count("EDGE_SE2") == 27
    assert main(command) == 0
    assert json.loads(report.read_text())["chi2_after"] > 10 * found["chi2_after"]
    assert main([*command, "--outliers", str(table)]) == 2
    assert "--outliers: expected --robust" in capsys.readouterr().err


def test_edges_of_indefinite_or_singular_information_are_named_and_left_out_on_request(tmp_path, capsys):
    bad = ["EDGE_SE2 0 8 0 0 0 100 200 0 100 0 400", "EDGE_SE2 1 9 0 0 0 1 1 0 1 0 1"]
    graph, out = square(tmp_path / "graph.g2o", bad), tmp_path / "out.g2o"
    assert main(["optimize", str(graph), "-o", str(out)]) == 2
    told = capsys.readouterr().err
    assert "graph.g2o:28: edge 0 8: expected a positive definite information matrix" in told
    assert "and 1 more" in told
    assert "--leave-out-indefinite" in told
    assert main(["optimize", str(graph), "-o", str(out), "--leave-out-indefinite"]) == 0
    told = capsys.readouterr().out
    assert "left out: " in told
    assert "graph.g2o:29: edge 1 9: expected" in told
    assert out.read_text().count("EDGE_SE2") == 27
