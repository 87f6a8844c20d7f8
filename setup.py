"""Package of the arm_brachy cell, for `colcon build` and for pip alike."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'arm_brachy'
NODES = (
    'cell_clock',
    'tissue_simulator',
    'tissue_model',
    'mismatch_monitor',
    'actuator_driver',
    'em_tracker',
    'optical_tracker',
    'force_sensor',
    'probe_controller',
    'kf_admm_estimator',
    'graph_vae_estimator',
    'map_estimator',
    'pod_estimator',
    'mpc_manipulator',
    'operator',
    'needle_driver',
    'ultrasound_imager',
    'surface_scanner',
    'push_protocol',
    'recorder',
    'replayer',
    'cell_viewer',
    'live_view',
    'release_client',
    'goal_client',
    'abuse_bench',
    'abuse_probe_bench',
    'supervisor',
)


def shared_files():
    """Return data_files: the configuration tree and the launch scripts under share/arm_brachy."""
    config = [path for path in Path('config').rglob('*') if path.is_file()]
    folders = {}
    for path in sorted([*config, *Path('launch_scripts').glob('cell*.py')]):
        folders.setdefault(f'share/{NAME}/{path.parent}', []).append(str(path))
    return [
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *folders.items(),
    ]


setup(
    name=NAME,
    version='0.1.0',
    description='A robotic cell for permanent-seed breast brachytherapy as a ROS 2 graph',
    maintainer='arm_brachy maintainers',
    maintainer_email='maintainers@arm-brachy.invalid',
    license='MIT',
    python_requires='>=3.11',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['**/*.html', '**/*.j2', '**/*.css', '**/*.js', '**/*.md', '**/*.npz',
                         '**/*.csv']},
    data_files=shared_files(),
    # What the package needs besides ROS is in package.xml; the versions it was tested with are
    # in requirements.txt.
    install_requires=['setuptools'],
    zip_safe=False,
    entry_points={
        'console_scripts': [
            'arm-brachy = arm_brachy.cli:main',
            *(f'{node} = {NAME}.nodes.{node}:main' for node in NODES),
        ],
        # A hardware driver is another package's entry point in this group.
        'arm_brachy.actuator_drivers': ['simulated = arm_brachy.devices.actuator:SimulatedBank'],
    },
)
