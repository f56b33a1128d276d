"""`python -m benchmarks.fault_page [FOLDER]`: docs/faults.md, and what other pages promise of stops, as measured.

From faults.json and fault_busy.json of full size, which the benchmarks left in out/bench.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from benchmarks.report import COLUMNS, Table

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("docs/faults.md", "docs/on_a_vehicle.md", "README.md")
LIMIT, ENDED = 0.85, ("SIGINT", "SIGTERM")  # s to zero that is usual; rows that are promised apart


def main(folder: Path) -> int:
    """Write what is between the marks anew."""
    found = [json.loads((folder / f"{name}.json").read_text(encoding="utf-8")) for name in ("faults", "fault_busy")]
    if any(entry["size"] != "full" for entry in found):
        print(f"{folder}: expected faults.json and fault_busy.json of full size", file=sys.stderr)
        return 2
    tables = [Table(table["title"], tuple(table["columns"]), table["rows"]) for one in found for table in one["tables"]]
    tables.append(Table("Bounds", COLUMNS, [tuple(bound["cells"]) for one in found for bound in one["bounds"]]))
    replaced = {"stops": promises(*found), "measured": "\n\n".join(t.markdown()[1:] for t in tables)}
    for page in PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        for mark, new in replaced.items():
            text = re.sub(
                rf"(<!-- {mark}: begin -->\n).*?(<!-- {mark}: end -->)", rf"\g<1>{new}\n\g<2>", text, flags=re.S
            )
        (ROOT / page).write_text(text, encoding="utf-8")
    return 0


def promises(drives: dict[str, Any], processes: dict[str, Any]) -> str:
    """Return what one may rely on, a table."""
    times = {row[1]: float(row[5]) for row in drives["tables"][0]["rows"] if row[5] != "–"}
    real = {row[0]: max(map(float, row[2:])) for row in processes["tables"][0]["rows"]}
    times |= {name: time for name, time in real.items() if name not in ENDED}
    usual = max(time for time in times.values() if time <= LIMIT)
    told = {"pose lost, late, doubted or wrong": f"{usual:.2f} s"}
    told |= {f"but: {name}": f"{time:.1f} s" for name, time in times.items() if time > LIMIT}
    told |= {"emergency stop": f"{real['emergency stop']:.2f} s"}
    told |= {"Ctrl-C or SIGTERM": f"{max(real[name] for name in ENDED):.2f} s"}
    rows = [f"| {what} | {within} |" for what, within in told.items()]
    return "\n".join(["| what happens at 1.4 m/s | zero commanded within |", "| --- | --- |", *rows])


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/bench")))
