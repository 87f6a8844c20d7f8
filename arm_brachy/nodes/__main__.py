"""`python -m arm_brachy.nodes NAME --ros-args ...`: one node, wherever the package is found."""

import importlib
import sys

if __name__ == '__main__':
    try:
        importlib.import_module(f'arm_brachy.nodes.{sys.argv[1]}').main()
    except KeyboardInterrupt:  # asked to end while still importing: nothing was begun
        sys.exit(0)
