"""Install wheels into the environment whose Python runs this: `install_wheels.py ARGUMENTS`, those of `pip install`.

uv does it in a tenth of pip's time. It does not read pip's settings: those that say where wheels come from are passed
on. Where uv cannot be had, or fails, pip does it.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys

PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
SECTIONS = ("global", "install", ":env:")  # of pip's settings; the last that names one holds
OPTIONS = {  # pip's setting, of one or more words -> uv's option
    "index-url": "--default-index",
    "extra-index-url": "--index",
    "find-links": "--find-links",
    "constraint": "--constraint",
    "trusted-host": "--allow-insecure-host",
}
VARIABLES = {"cert": "SSL_CERT_FILE", "proxy": "ALL_PROXY"}  # pip's setting -> the variable that uv reads


def pip_settings() -> dict[str, str]:
    """Return pip's settings by name, from its files and from PIP_* variables."""
    listing = subprocess.run([*PIP, "config", "list"], capture_output=True, text=True, check=True).stdout
    found: dict[str, dict[str, str]] = {section: {} for section in SECTIONS}
    for line in listing.splitlines():
        key, _, value = line.partition("=")
        section, _, name = key.rpartition(".")
        if section in found:
            found[section][name] = str(ast.literal_eval(value))
    return found["global"] | found["install"] | found[":env:"]


def uv_options(settings: dict[str, str]) -> list[str]:
    """Return what tells uv to take wheels from where pip takes them: the best version of all indexes."""
    options = [f"{option}={word}" for name, option in OPTIONS.items() for word in settings.get(name, "").split()]
    if settings.get("no-index", "").lower() in {"1", "true", "yes", "on"}:
        options.append("--no-index")
    return ["--index-strategy=unsafe-best-match", *options]


def install_by_uv(arguments: list[str]) -> bool:
    """Install by uv; False where that failed, with uv's reason printed."""
    if subprocess.run([*PIP, "install", "-qq", "-c", "constraints.txt", "uv"], check=False).returncode:
        return False
    settings = pip_settings()
    variables = {variable: settings[name] for name, variable in VARIABLES.items() if name in settings}
    command = [sys.executable, "-m", "uv", "pip", "install", "-q", "--python", sys.executable]
    done = subprocess.run([*command, *uv_options(settings), *arguments], env=variables | os.environ, check=False)
    return done.returncode == 0


def install_by_pip(arguments: list[str]) -> int:
    """Install by pip, of the version that constraints.txt names; return its exit code."""
    sys.stderr.write("env: uv is not there or did not install them: pip does, which takes a minute or two\n")
    own = subprocess.run([*PIP, "install", "-q", "-c", "constraints.txt", "--upgrade", "pip"], check=False)
    return own.returncode or subprocess.run([*PIP, "install", "-q", *arguments], check=False).returncode


def main() -> int:
    """Install by uv, else by pip; return the exit code."""
    arguments = sys.argv[1:]
    return 0 if install_by_uv(arguments) else install_by_pip(arguments)


if __name__ == "__main__":
    sys.exit(main())
