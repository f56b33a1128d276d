"""`sphere_nav map`: the learning phase, offline, through the very callbacks of the node `sphere_mapper`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
from tqdm import tqdm

from node_kit.bags import BagError, BagReader
from node_kit.map_bag import MapDetails, MapReader, MapWriter
from node_kit.map_writer import MAP_FRAME
from node_kit.replay import OfflineBus, replay, required_topics
from sphere_geometry import SE3
from sphere_geometry.rig_file import read_rig
from sphere_geometry.trajectory import write_tum
from sphere_map.graph import SphereGraph
from sphere_mapping.acquisition.kernels import use_threads
from sphere_mapping.acquisition.stereo_pair import StereoPair
from sphere_mapping.details_node import details_of
from sphere_mapping.graph.merging import merge
from sphere_mapping.graph.store import SphereStore
from sphere_mapping.intake_node import TOPICS
from sphere_mapping.mapper import Mapper
from sphere_mapping.node import SphereMapper
from sphere_mapping.params import MapperParams
from sphere_nav_cli import topics
from sphere_nav_cli.depth_drive import judge_depth
from sphere_nav_cli.evaluate import TRUTH_TOPICS
from sphere_nav_cli.map_drive import MappedDrive
from sphere_nav_cli.map_extend import extend, first_id, open_base
from sphere_nav_cli.map_truth import Truth, move_to_truth, transform_graph, truth_of
from sphere_nav_cli.settings import parse_settings
from sphere_nav_cli.sphere_source import CAMERAS, find_input
from sphere_nav_cli.stereo_drive import find_field
from sphere_nav_cli.stitcher_ahead import StitcherAhead, stitch_apart
from sphere_nav_cli.survey import check_survey
from sphere_nav_cli.workers import Workers

NUM_THREADS = 2  # of this process, which registers one sphere after the other
OFFLINE_DEADLINE_S = 10.0  # of recording time: a recording may hold images as late as they were drawn or written
HELP = """\
Make a map of key spheres from a bag with spheres, RGB-D, stereo images, or the cameras of a rig.

The bag holds spheres; or images, camera_info and depth; or a stereo pair with both camera_info (raw images are
rectified by D, R and P or by /tf_static; what the images themselves show to be off is told and corrected); or, with
--rig, the cameras of a rig, which go through the node sphere_stitcher. Topics of any names are found by type, name,
frame and size (`sphere_nav inspect BAG` shows how), or named by options. The map frame is the pose of the first sphere
(body axes). The result is the same for every number of jobs. Where an RGB-D drive contradicts the place of its depth
camera, one line says so (`sphere_nav refine-camera --help`).

examples:
  sphere_nav map kitchen -o kitchen_map
  sphere_nav map kitchen -o kitchen_map --anchor truth --trajectory kitchen.tum
  sphere_nav map campus_drive -o campus --taught campus.tum
  sphere_nav map recording -o hall --image /camera/color/image_raw --depth /camera/aligned_depth_to_color/image_raw
  sphere_nav map kitchen -o kitchen_map --set depth_pose=depth.yaml
  sphere_nav map drive -o drive_map --anchor survey
  sphere_nav map second_drive -o both_maps --extend drive_map
  sphere_nav map six_cameras -o drive_map --rig rig.yaml --set-stitcher stitch.width=2048
  sphere_nav map six_cameras -o drive_map --rig old_rig.yaml --set-stitcher rectify.num_instants=5
  sphere_nav map drive -o drive_map --set mapper.key.min_overlap=0.5 --set mapper.stereo.nearest_m=2
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="bag of the teaching drive")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="MAP", help="map to make (a folder)")
    parser.add_argument(
        "--extend", type=Path, metavar="MAP0", help="a map that the drive is joined to, where both saw the same places"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a map that is there")
    parser.add_argument(
        "--anchor",
        choices=("first", "truth", "survey"),
        default="first",
        help="first: the first pose is the origin; truth: the map, as it is, fitted to the truth; survey: every key "
        "sphere where the truth has it, as after a surveyed drive (%(default)s)",
    )
    parser.add_argument("--rig", type=Path, metavar="F", help="rig file, for a bag with the cameras of a rig")
    parser.add_argument(
        "--input", choices=("auto", *TOPICS, CAMERAS), default="auto", help="what is mapped (by the topics)"
    )
    topics.add_options(parser)
    parser.add_argument("--no-loops", action="store_true", help="do not look for places seen twice")
    parser.add_argument(
        "--jobs", type=_positive, default=1, metavar="N", help="processes that stitch and look for loops (%(default)s)"
    )
    parser.add_argument(
        "--scheduler", default="", metavar="ADDRESS", help="do that on a Dask cluster (needs distributed)"
    )
    parser.add_argument("--trajectory", type=Path, metavar="F", help="write the pose of every sphere (TUM)")
    parser.add_argument("--taught", type=Path, metavar="F", help="write the vehicle's poses, for path_follower (TUM)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", dest="settings", help="parameter of sphere_mapper"
    )
    parser.add_argument(
        "--set-stitcher", action="append", default=[], metavar="NAME=VALUE", help="parameter of sphere_stitcher"
    )


def run(arguments: argparse.Namespace) -> int:
    """Map what the bag holds; each key sphere is written as it is kept."""
    if arguments.output.exists() and not arguments.overwrite:
        raise BagError(f"{arguments.output}: expected no such file or folder, found one: --overwrite replaces a map")
    if arguments.extend and arguments.anchor != "first":
        raise BagError(f"--anchor: expected first, as --extend keeps the frame of its map, found {arguments.anchor}")
    cv2.setNumThreads(NUM_THREADS)
    use_threads(NUM_THREADS)
    with ExitStack() as stack:
        workers, base = stack.enter_context(Workers(arguments.jobs, arguments.scheduler)), None
        if arguments.extend:
            base = stack.enter_context(open_base(arguments.extend, arguments.output, rig_text(arguments)))
        writer = MapWriter(arguments.output, start_of(arguments), is_overwriting=arguments.overwrite)
        try:
            drive = map_drive(arguments, writer, first_id(base), workers)
            return finish(arguments, drive, writer, base, workers)
        except (ValueError, OSError):  # an interrupted run leaves what it has, for `map-verify --salvage`
            writer.discard()
            raise


def finish(
    arguments: argparse.Namespace, drive: MappedDrive, writer: MapWriter, base: MapReader | None, workers: Workers
) -> int:
    """Close loops, join the drive to a map, compare with the truth, complete the map."""
    mapper, told = drive.node.mapper, list[str]()
    mapper.keep_end()
    if not arguments.no_loops:
        mapper.close_loops(workers.run)
    index = mapper.appearance
    if base is not None:
        extension = extend(base, mapper, workers.run)
        index, told = extension.index, [extension.told]
    truth = truth_of(arguments.bag)
    T_new_map, graph, warnings = place(arguments, drive, truth)
    if mapper.params.key.merge:
        places = drive.trajectory(is_base=False).moved(T_new_map).positions
        merged = merge(graph, places, base.graph.nodes if base is not None else ())
        told += [f"{len(merged.replaced)} key spheres merged with others of their places"] if merged.replaced else []
        graph = merged.graph
    writer.finish(graph, complete(graph, arguments, drive, base), index, base.stored() if base is not None else ())
    if arguments.trajectory:
        write_tum(arguments.trajectory, drive.trajectory(is_base=False).moved(T_new_map))
    if arguments.taught:
        write_tum(arguments.taught, drive.trajectory(is_base=True).moved(T_new_map))
    T_anchor_map = drive.anchor(truth) if truth is not None else None
    lines = [*drive.summary(mapper.num_loops, truth, T_anchor_map), *told, *warnings]
    print("\n".join([*lines, f"map: {arguments.output}, {_size(arguments.output)}"]))
    return 0


def place(arguments: argparse.Namespace, drive: MappedDrive, truth: Truth | None) -> tuple[SE3, SphereGraph, list[str]]:
    """Return T_new_map as the anchor asks for, the graph there, and what is to be warned of."""
    graph = drive.node.mapper.graph
    if arguments.anchor == "first":
        return SE3.identity(), graph, []
    T_fitted_map = drive.fit(truth) if truth is not None else None
    if truth is None or T_fitted_map is None:
        raise BagError(
            f"{arguments.bag}: {' or '.join(TRUTH_TOPICS)}: expected poses at the stamps of the spheres, found none"
        )
    graph = transform_graph(graph, T_fitted_map)
    if arguments.anchor == "truth":
        return T_fitted_map, graph, []
    surveyed = move_to_truth(graph, truth, drive.node.T_base_sphere)
    return T_fitted_map, surveyed, check_survey(graph, surveyed, str(arguments.bag))


def start_of(arguments: argparse.Namespace) -> MapDetails:
    """Return what the map says of itself until it is complete."""
    return MapDetails(source=str(arguments.bag.name), rig=rig_text(arguments))


def complete(
    graph: SphereGraph, arguments: argparse.Namespace, drive: MappedDrive, base: MapReader | None
) -> MapDetails:
    """Return what the complete map says of itself."""
    source, frame = str(arguments.bag.name), MAP_FRAME
    if base is not None:
        source, frame = f"{base.info.source} + {source}", base.info.header.frame_id
    return replace(details_of(graph, drive.node.params.mapper, source, frame), rig=rig_text(arguments))


def rig_text(arguments: argparse.Namespace) -> str:
    """Return the rig file as it is, empty without one."""
    return arguments.rig.read_text(encoding="utf-8") if arguments.rig else ""


def map_drive(arguments: argparse.Namespace, store: SphereStore, first: int, workers: Workers) -> MappedDrive:
    """Return the bag mapped from what it holds; BagError where no sphere comes of it."""
    given = {"mapper.loop.automatic": not arguments.no_loops, "mounting": arguments.mounting}
    values = given | parse_settings(arguments.settings)
    with BagReader(arguments.bag) as bag:
        chosen = topics.choose_topics(bag, arguments)
        kind = arguments.input

        def begin(params: MapperParams) -> Mapper:
            mapper = Mapper(params, store=store)
            mapper.first_id = first
            return mapper

        if kind == "auto":
            kind = find_input(bag, chosen, has_rig=arguments.rig is not None)
        if kind == CAMERAS:
            stitcher = stitcher_values(bag, chosen, arguments)
            drive = replay_mapper(bag, begin, values | {"input": "sphere"}, {}, stitcher, workers=workers)
        else:
            found = topics.find_topics(bag, TOPICS[kind], chosen)
            slack_s = topics.pairing_slack(bag, found[TOPICS[kind][0]])
            values = {"slack_s": slack_s} | values | {"input": kind}
            stereo = find_field(bag, values, found) if kind == "stereo" else None
            drive = replay_mapper(bag, begin, values, found, pair=stereo and stereo[0])
            drive.stereo = stereo[1] if stereo else ""
            drive.depth = judge_depth(bag, values, found, drive.node.mapper) if kind == "rgbd" else ""
    if not drive.node.mapper.tracks:
        raise BagError(
            f"{arguments.bag}: expected spheres to map, found none: {drive.refusal or 'no complete instant'}"
        )
    return drive


Node = tuple[dict[str, Any], dict[str, str]]  # values of parameters by dotted name, topics of the bag by ours


def replay_mapper(
    bag: BagReader,
    begin: Callable[[MapperParams], Mapper],
    values: dict[str, Any],
    remap: dict[str, str],
    stitcher: Node | None = None,
    pair: StereoPair | None = None,
    workers: Workers | None = None,
) -> MappedDrive:
    """Play a bag to a mapper, behind a stitcher where that is given, or with a stereo pair's correction."""
    bus = OfflineBus(captured=set())
    stitching = None if stitcher is None else bus.add(StitcherAhead, *stitcher)
    if stitcher is not None and workers is not None and workers.executor is not None:
        assert isinstance(stitching, StitcherAhead)
        stitching.coming_from = stitch_apart(bag.path, *stitcher, workers.executor, workers.num_ahead)
    node = bus.add(SphereMapper, values, remap)
    assert isinstance(node, SphereMapper)
    node.mapper = begin(node.params.mapper)
    if pair is not None:
        node.intake.stereo.use(pair)
    total = sum(bag.topics[topic].count for topic in required_topics(bag, bus))
    try:
        with tqdm(total=total, desc="map", unit="message", leave=False, disable=None) as bar:
            for _ in replay(bag, bus, progress=bar.update):
                pass
            if isinstance(stitching, StitcherAhead):
                stitching.finish_open()
                stitching.publish_last()
                for _ in bus.settle():
                    pass
    finally:
        if stitching is not None:
            stitching.cleanup()
    inputs = [*node.inputs, *(stitching.inputs if stitching else ())]
    reasons = [f"{w.num_refused} of {w.topic}: {w.last_refusal}" for w in inputs if w.num_refused]
    if isinstance(stitching, StitcherAhead) and stitching.intake is not None:
        for name, health in stitching.intake.sync.health.items():
            if health.problem:
                reasons.append(f"{name}: {health.problem} ({health.num_missing} times)")
    return MappedDrive(node, node.num_lost, "; ".join(reasons))


def stitcher_values(bag: BagReader, chosen: dict[str, str], arguments: argparse.Namespace) -> Node:
    """Return parameters and topics of the stitcher for a bag with cameras; BagError where bag and rig do not fit."""
    if arguments.rig is None:
        raise BagError(f"{bag.path}: expected --rig with the rig file of its cameras, found none")
    remap = topics.find_rig_topics(bag, read_rig(arguments.rig).names, chosen)
    values = {"sync.deadline_s": OFFLINE_DEADLINE_S} | parse_settings(arguments.set_stitcher)
    return values | {"rig": str(arguments.rig), "transport": "raw", "jobs": NUM_THREADS}, remap


def _size(path: Path) -> str:
    return f"{sum(file.stat().st_size for file in path.iterdir()) / 1e6:.1f} MB"


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"expected at least 1, found {text}")
    return number
