"""`arm-brachy rcm`: what a spherical scissor linkage does at a pose."""

from dataclasses import replace

import click
import numpy as np

from arm_brachy.cli.output import json_option, show, summary
from arm_brachy.core.errors import InputError
from arm_brachy.core.quantity import quantities
from arm_brachy.robot.scissor_rcm import (
    ScissorParams,
    clear_range,
    global_conditioning,
    isotropy,
    joint_angles,
    polar_angle,
    tip,
)
from arm_brachy.robot.scissor_stiffness import radial_stiffness

QUANTITIES = quantities(ScissorParams)


def _with_options(command):
    """Give the command an option for every quantity of ScissorParams."""
    for name, info in reversed(QUANTITIES.items()):
        flag = '--' + info.key(name).replace('_', '-')
        default = info.to_edge(getattr(ScissorParams(), name))
        command = click.option(flag, name, type=float, default=default, show_default=True,
                               help=info.text)(command)
    return command


@click.command()
@click.option('--links', type=click.IntRange(1, 40), default=5, show_default=True,
              help='arcs of each branch')
@_with_options
@click.option('--polar-deg', type=float, default=45.0, show_default=True,
              help='angle of the tip from the axis of the first hinge')
@click.option('--azimuth-deg', type=float, default=0.0, show_default=True, help='about that axis')
@json_option
def rcm(links, polar_deg, azimuth_deg, json_file, **given):
    """Pose, stiffness and isotropy of the scissor probe holder.

    \b
    Example:
      arm-brachy rcm --links 5 --beta-deg 18 --polar-deg 60
    """
    params = replace(ScissorParams(links=links), **{
        name: _checked(name, value) for name, value in given.items()})
    polar, azimuth = np.radians([polar_deg, azimuth_deg])
    direction = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    theta_0, theta_1 = joint_angles(params, direction)
    show(summary('rcm', [_row(params, theta_0, theta_1)]), json_file)


def _checked(name, value):
    info = QUANTITIES[name]
    if not info.allows(value):
        raise InputError(f"--{info.key(name).replace('_', '-')} {value:g}; must be "
                         f'{info.allowed()}')
    return info.to_si(value)


def _row(params, theta_0, theta_1):
    low, high = clear_range(params)
    x, y, z = tip(params, theta_0, theta_1)
    return {
        'theta_0_deg': float(np.degrees(theta_0)), 'theta_1_deg': float(np.degrees(theta_1)),
        'polar_deg': float(np.degrees(polar_angle(params, theta_1))),
        'tip_x_mm': 1e3 * float(x), 'tip_y_mm': 1e3 * float(y), 'tip_z_mm': 1e3 * float(z),
        'radial_stiffness_N_m': radial_stiffness(params, theta_1),
        'isotropy': float(isotropy(params, theta_1)),
        'gci_mean_over_polar': global_conditioning(params, 'polar'),
        'clear_from_deg': float(np.degrees(low)), 'clear_to_deg': float(np.degrees(high)),
        'links_touch': bool(not low <= theta_1 <= high)}
