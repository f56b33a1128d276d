"""The learning phase, offline: a drive through the very callbacks of the nodes -> a map."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import cv2

from sphere_mapping.acquisition.kernels import use_threads
from sphere_mapping.graph.merging import merge
from sphere_mapping.graph.store import SphereStore
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_mapping.ros.intake import TOPICS
from sphere_mapping.ros.saving import details_of
from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, read_text
from sphere_nav.geometry.trajectory import write_tum
from sphere_nav.offline import topics
from sphere_nav.offline.evaluation import TRUTH_TOPICS
from sphere_nav.offline.mapping.depth_drive import judge_depth
from sphere_nav.offline.mapping.drive import MappedDrive
from sphere_nav.offline.mapping.extension import extend, first_id, open_base
from sphere_nav.offline.mapping.replay_mapper import NUM_THREADS, replay_mapper, stitcher_values
from sphere_nav.offline.mapping.sphere_source import CAMERAS, find_input
from sphere_nav.offline.mapping.stereo_drive import find_field
from sphere_nav.offline.mapping.survey import check_survey
from sphere_nav.offline.mapping.truth import Truth, move_to_truth, transform_graph, truth_of
from sphere_nav.offline.mapping.workers import Workers
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.maps.reader import MapDetails, MapReader, MapWriter
from sphere_nav.ros.maps.writer import MAP_FRAME
from sphere_nav.spheres.graph import SphereGraph


def learn(arguments: argparse.Namespace) -> int:
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
            return finish_map(arguments, drive, writer, base, workers)
        except (ValueError, OSError):  # an interrupted run leaves what it has, for `map-verify --salvage`
            writer.discard()
            raise


def finish_map(
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
    T_new_map, graph, warnings = anchor_map(arguments, drive, truth)
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


def anchor_map(
    arguments: argparse.Namespace, drive: MappedDrive, truth: Truth | None
) -> tuple[SE3, SphereGraph, list[str]]:
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
    return read_text(arguments.rig, "rig file", MAX_FILE_BYTES) if arguments.rig else ""


def map_drive(arguments: argparse.Namespace, store: SphereStore, first: int, workers: Workers) -> MappedDrive:
    """Return the bag mapped from what it holds; BagError where no sphere comes of it."""
    given = {"mapper.loop.automatic": not arguments.no_loops, "mounting": arguments.mounting}
    values = given | arguments.settings
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


def _size(path: Path) -> str:
    return f"{sum(file.stat().st_size for file in path.iterdir()) / 1e6:.1f} MB"
