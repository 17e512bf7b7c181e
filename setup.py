"""Installation of the ROS 2 package mbaid_ros; built by colcon."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'mbaid_ros'


def files(folder: str, pattern: str) -> list[str]:
    """Return the files of a folder, relative to this one, as setuptools wants them."""
    return sorted(str(path) for path in Path(folder).glob(pattern))


setup(
    name=PACKAGE,
    version='0.2.0',
    description='Momentum-based inertia identification of captured debris on free-floating robots.',
    license='Apache-2.0',
    maintainer='mbaid_ros maintainers',
    maintainer_email='maintainers@mbaid-ros.example.org',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={f'{PACKAGE}.replay.report': ['style.css'], f'{PACKAGE}.recordings': ['*.yaml', '*.urdf']},
    python_requires='>=3.10',
    install_requires=['setuptools'],
    extras_require={'test': ['pytest'], 'dask': ['distributed'], 'blackbox': ['orangebox==0.3.1']},
    zip_safe=True,
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', files('config', '*.*')),
        (f'share/{PACKAGE}/config/sros2', files('config/sros2', '*.*')),
        # Bags name the type of every message: replay needs the definitions, not the built interface package.
        (f'share/{PACKAGE}/msg', files('msg_defs/msg', '*.msg')),
    ],
    entry_points={
        'console_scripts': [
            'simulator = mbaid_ros.nodes.start:simulator',
            'estimator = mbaid_ros.nodes.start:estimator',
            'recorder = mbaid_ros.nodes.start:recorder',
            'player = mbaid_ros.nodes.start:player',
            'watch = mbaid_ros.nodes.start:watch',
            'simulate = mbaid_ros.replay.arguments:simulate',
            'plan = mbaid_ros.replay.arguments:plan',
            'replay = mbaid_ros.replay.arguments:replay',
            'calibrate = mbaid_ros.replay.arguments:calibrate',
            'campaign = mbaid_ros.replay.arguments:campaign',
            'convert = mbaid_ros.recordings.convert:main',
            'export = mbaid_ros.replay.arguments:export',
            'noise_at_rest = mbaid_ros.replay.arguments:noise_at_rest',
        ],
    },
)
