"""Start, run and end one node; the only init and shutdown in the package."""

import signal
import sys

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.executors import ExternalShutdownException

from arm_brachy.core.errors import ArmBrachyError


def spin_node(make_node, args=None):
    """Run one node until it is interrupted or asks to end.

    make_node : callable returning a Node
    Exits with the status of an ArmBrachyError (its one line on stderr), else 0. A second Ctrl-C
    does not cut the clean-up short.
    """
    rclpy.init(args=args)
    node = None
    try:
        node = make_node()
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RCLError:  # a publish that was under way when the signal shut the context down
        if rclpy.ok():
            raise
    except ArmBrachyError as error:
        raise SystemExit(_report(node, error)) from None
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        try:
            if node is not None:
                _end(node)
        finally:
            rclpy.try_shutdown()


def act_once(make_node, act, args=None):
    """Run one node for what it does once: `act(node)`; exits with status 0 then.

    make_node : callable returning a Node;  the rest as in `spin_node`
    """
    def acted():
        act(make_node())
        raise SystemExit(0)
    spin_node(acted, args)


def _end(node):
    close = getattr(node, 'close', None)
    try:
        if close is not None:
            close()
    finally:
        node.destroy_node()


def _report(node, error):
    name = node.get_name() if node is not None else 'arm_brachy'
    print(f'{name}: {error}', flush=True, file=sys.stderr)
    return error.exit_status
