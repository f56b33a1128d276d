"""`sphere_nav operate`: the operator's page, in a web browser."""

from __future__ import annotations

import argparse
import ipaddress
import os
import secrets
import shlex
import threading
from pathlib import Path

from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.operate.page import OperatorPage
from sphere_nav_tools.cli.operate.teaching import Teaching
from sphere_nav_tools.cli.view.server import import_viser

HELP = """\
Serve a page in a web browser: teach a drive, make its map, choose a path or a place and go, pause, stop, and see on the
map where the vehicle is, what it does, why it stands and what to do. The nodes run by themselves (`sphere_nav up
navigation`); losing the page changes nothing, unless its dead-man switch is on.

It serves this machine only. With another --host a token is asked for: that of --token or SPHERE_NAV_TOKEN, else a new
one, which is printed. The emergency stop of the page does not replace the one on the vehicle.

examples:
  sphere_nav operate --folder maps
  sphere_nav operate --folder maps --host 0.0.0.0
  sphere_nav operate --folder maps --namespace car2 --map-options "--rig rig.yaml"
"""
TOKEN_VARIABLE = "SPHERE_NAV_TOKEN"
MIN_TOKEN = 8  # characters


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--folder", type=Path, default=Path(), metavar="DIR", help="of recordings, maps and paths (.)")
    parser.add_argument("--host", default="127.0.0.1", help="address to serve at (%(default)s: this machine only)")
    parser.add_argument("--port", type=int, default=8081, help="port, or the next free one (%(default)s)")
    parser.add_argument("--token", default="", help=f"what a browser has to know; also {TOKEN_VARIABLE}")
    parser.add_argument("--namespace", default="", help="of the vehicle's nodes")
    parser.add_argument("--image", default="image_raw", metavar="TOPIC", help="picture to show (%(default)s)")
    parser.add_argument("--record", default="", metavar="TOPICS", help="to record (cameras, laser, IMU, odometry, tf)")
    parser.add_argument("--map-options", default="", metavar="WORDS", help="more words for `sphere_nav map`")


def run(arguments: argparse.Namespace) -> int:
    """Serve until interrupted."""
    import_viser("operate")
    token = token_for(arguments.host, arguments.token or os.environ.get(TOKEN_VARIABLE, ""))
    folder = arguments.folder.resolve()
    if not folder.is_dir():
        raise ValueError(f"--folder: expected a folder, found {folder}")
    what = ["-p", f"topics:={arguments.record}"] if arguments.record else ["-p", "topic_set:=raw"]
    teaching = Teaching(folder, what, shlex.split(arguments.map_options))
    link = Link(arguments.namespace, arguments.image)
    try:
        page = OperatorPage(link, teaching, host=arguments.host, port=arguments.port, token=token)
        print(f"http://{arguments.host}:{page.port}  {f'token {token}  ' if token else ''}(Ctrl-C ends it)", flush=True)
        try:
            threading.Event().wait()
        finally:
            page.close()
    finally:
        link.close()
        teaching.close()
    return 0


def token_for(host: str, given: str) -> str:
    """Return the token that is asked for at an address; empty: none, where only this machine is served."""
    if given and len(given) < MIN_TOKEN:
        raise ValueError(f"--token: expected {MIN_TOKEN} characters or more, found {len(given)}")
    try:
        is_local = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        is_local = False
    return given or ("" if is_local else secrets.token_urlsafe(16))
