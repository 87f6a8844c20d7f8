"""`python -m arm_brachy.nodes NAME --ros-args ...`: one node, wherever the package is found."""

import importlib
import sys
from pathlib import Path

NAMES = sorted(p.stem for p in Path(__file__).parent.glob('[!_]*.py')
               if '\ndef main(' in p.read_text())

if __name__ == '__main__':
    if len(sys.argv) < 2 or sys.argv[1] not in NAMES:
        given = sys.argv[1] if len(sys.argv) > 1 else 'no name'
        print(f'arm_brachy.nodes: got {given}; must be one of {", ".join(NAMES)}',
              file=sys.stderr)
        sys.exit(2)
    try:
        importlib.import_module(f'arm_brachy.nodes.{sys.argv[1]}').main()
    except KeyboardInterrupt:  # asked to end while still importing: nothing was begun
        sys.exit(0)
