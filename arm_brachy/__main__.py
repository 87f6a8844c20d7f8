"""`python -m arm_brachy COMMAND ...`: the command line, wherever the package is found."""

from arm_brachy.cli import main

if __name__ == '__main__':
    main(prog_name='arm-brachy')
