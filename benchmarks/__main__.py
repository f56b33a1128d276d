"""Run benchmarks by name, all without a name; print Markdown, write JSON. Exit code: 1 one broke, 2 one refused."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import traceback
from pathlib import Path
from types import ModuleType

from benchmarks.machine import describe, num_cores, set_threads
from benchmarks.report import Report

PLACES = ("--json", "--output", "--live-images")  # options that say where something is kept: nothing depends on it
BENCHMARKS = {
    "kernel_times": "benchmarks.kernel_times",
    "localizer_times": "benchmarks.localizer_times",
    "localizer_start": "benchmarks.localizer_start",
    "localizer_rate": "benchmarks.localizer_rate",
    "frame_to_frame": "benchmarks.frame_to_frame",
    "first_motion": "benchmarks.first_motion",
    "end_to_end": "benchmarks.end_to_end",
    "repeats": "benchmarks.repeats",
    "faults": "benchmarks.faults",
    "busy": "benchmarks.fault_busy",
    "doubts": "benchmarks.doubts",
    "stops": "benchmarks.stops",
    "lifecycle": "benchmarks.lifecycle",
    "localizer_faults": "benchmarks.localizer_faults",
    "following": "benchmarks.following",
    "long_drive": "benchmarks.long_drive",
    "join": "benchmarks.join",
    "missions": "benchmarks.missions",
    "mounting": "benchmarks.mounting",
    "calibration": "benchmarks.calibration",
    "calibration_doubts": "benchmarks.calibration_doubts",
    "stitching": "benchmarks.stitching",
    "mapping_times": "benchmarks.mapping_times",
    "range_honesty": "benchmarks.range_honesty",
    "range_classes": "benchmarks.range_classes",
    "pose_graphs": "benchmarks.pose_graphs",
    "outlier_loops": "benchmarks.outlier_loops",
    "pair_registration": "benchmarks.pair_registration",
    "long_map": "benchmarks.long_map",
    "map_scaling": "benchmarks.map_scaling",
    "view_synthesis": "benchmarks.view_synthesis",
    "region": "benchmarks.region",
    "key_spheres": "benchmarks.key_spheres",
    "pixel_choice": "benchmarks.pixel_choice",
    "map_jobs": "benchmarks.map_jobs",
    "nothing_lost": "benchmarks.nothing_lost",
    "mcl_panoramas": "benchmarks.mcl_panoramas",
    "mcl_surround": "benchmarks.mcl_surround",
    "mcl_street": "benchmarks.mcl_street",
    "mcl_walks": "benchmarks.mcl_walks",
    "mcl_homes": "benchmarks.mcl_homes",
    "mcl_rooms": "benchmarks.mcl_rooms",
    "mcl_town": "benchmarks.mcl_town",
    "mcl_wrong_map": "benchmarks.mcl_wrong_map",
    "mcl_kidnap": "benchmarks.mcl_kidnap",
    "contradictions": "benchmarks.contradictions",
    "mcl_cameras": "benchmarks.mcl_cameras",
    "mcl_ramp": "benchmarks.mcl_ramp",
    "mcl_corridor": "benchmarks.mcl_corridor",
    "mcl_homing": "benchmarks.mcl_homing",
    "mcl_times": "benchmarks.mcl_times",
    "fuzz": "benchmarks.fuzz",
    "zoo": "benchmarks.zoo",
    "endpoints": "benchmarks.endpoints",
    "abuse": "benchmarks.abuse",
    "map_streaming": "benchmarks.map_streaming",
    "intake_rate": "benchmarks.intake_rate",
    "live_rigs": "benchmarks.live_rigs",
    "soak": "benchmarks.soak",
    "relight": "benchmarks.relight",
    "relight_street": "benchmarks.relight_street",
    "dark": "benchmarks.dark",
    "learning": "benchmarks.learning",
    "false_joins": "benchmarks.false_joins",
}


def main() -> int:
    """Run what the command line names."""
    named = [word for word in sys.argv[1:] if word in BENCHMARKS] or list(BENCHMARKS)
    modules = {name: importlib.import_module(BENCHMARKS[name]) for name in named}
    parser = _parser(modules)
    options = parser.parse_args()
    folders = [name for name in options.names if name not in BENCHMARKS and Path(name).is_dir()]
    options.folders = [Path(name) for name in folders]
    options.names = [name for name in options.names if name not in folders] or list(BENCHMARKS)
    if folders and options.names != ["repeats"]:
        parser.error(f"DIR: expected with repeats alone, found {folders[0]}")
    if unknown := [name for name in options.names if name not in BENCHMARKS]:
        parser.error(f"NAME: expected one of {', '.join(BENCHMARKS)}, found {unknown[0]}")
    if options.json and len(options.names) != 1:
        parser.error(f"--json: expected one benchmark, found {len(options.names)}")
    set_threads(options.threads)
    return max([_run_one(name, modules[name], options) for name in options.names])


def _parser(modules: dict[str, ModuleType]) -> argparse.ArgumentParser:
    listing = "\n".join(f"  {name:16} {module.HELP}" for name, module in modules.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=f"Measure on this machine. Benchmarks:\n{listing}",
        epilog="example: python -m benchmarks frame_to_frame --data ../shared/data/rgbd/redkitchen --gaps 1 10",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="benchmarks to run (all); for repeats a folder, too")
    parser.add_argument("--quick", action="store_true", help="fewer runs, for a first look")
    parser.add_argument(
        "--threads",
        type=int,
        default=min(num_cores(), 2),
        help="threads for every library (2, as on the reference machine)",
    )
    parser.add_argument("--output", type=Path, default=Path("out/bench"), help="folder of the JSON files (out/bench)")
    parser.add_argument("--json", type=Path, metavar="F", help="file for the JSON of one benchmark (OUTPUT/NAME.json)")
    parser.add_argument("--starts", type=int, metavar="N", help="drives from anywhere (each mcl benchmark has its own)")
    for name, module in modules.items():
        module.add_arguments(parser.add_argument_group(name))
    return parser


def _run_one(name: str, module: ModuleType, options: argparse.Namespace) -> int:
    try:
        report: Report = module.run(options)
    except (ValueError, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    except Exception:  # one broken benchmark must not hide the others
        print(f"{name} broke:", file=sys.stderr)
        traceback.print_exc()
        return 1
    print(report.markdown(), end="\n\n", flush=True)
    path = options.json or options.output / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    found = report.as_mapping(_command(name), describe(options.threads))
    path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0


def _command(name: str) -> str:
    """Return the command line that measures one benchmark as it was measured now, wherever the result goes."""
    others = set(BENCHMARKS) - {name}
    given = sys.argv[1:]
    words = [word for word, last in zip(given, ["", *given], strict=False) if word not in others and last not in PLACES]
    words = [word for word in words if word not in PLACES]
    return " ".join(["python -m benchmarks", *([] if name in words else [name]), *words])


if __name__ == "__main__":
    sys.exit(main())
