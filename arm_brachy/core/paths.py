"""Where configuration, launch scripts and results are, in a source tree and when installed.

A package run from its source tree (`make setup`, `colcon build --symlink-install`) uses the files
beside it, so that an edited scene takes effect at once. An installed one uses share/arm_brachy of
its prefix, found by the ament index or, without ROS, by Python's own prefix.
"""

import os
import sys
from pathlib import Path

from arm_brachy.core.errors import InputError

PACKAGE = 'arm_brachy'


def config_dir():
    """Return the folder that holds scenes/ and scenarios/ (absolute Path)."""
    return share_dir() / 'config'


def launch_dir():
    """Return the folder that holds cell.py and cell.launch.py (absolute Path)."""
    return share_dir() / 'launch_scripts'


def run_dir():
    """Return the folder that receives runs (absolute Path, not created here).

    $ARM_BRACHY_RUNS where set, otherwise runs/ under the current folder.
    """
    return Path(os.environ.get('ARM_BRACHY_RUNS', 'runs')).resolve()


def share_dir():
    """Return the folder with package.xml, config/ and launch_scripts/ (absolute Path).

    Raises InputError, naming where it looked, if the package's files are nowhere.
    """
    source_tree = Path(__file__).resolve().parents[2]
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    installed = [Path(prefix) / 'share' / PACKAGE for prefix in (*prefixes, sys.prefix)]
    for folder in (source_tree, *installed):
        if (folder / 'package.xml').is_file():
            return folder
    places = ', '.join(str(folder) for folder in installed)
    raise InputError(
        f'no package.xml of {PACKAGE} in {places}; source the setup file of the workspace '
        'it was built in, or run `make setup`'
    )
