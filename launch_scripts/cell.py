#!/usr/bin/env python3
"""Launch a full scenario: `python launch_scripts/cell.py SCENARIO [options]`.

The same as `arm-brachy run SCENARIO`: starts every node of the cell, records, evaluates.
"""

import sys

from arm_brachy.cli import main

if __name__ == '__main__':
    main(['run', *sys.argv[1:]])
