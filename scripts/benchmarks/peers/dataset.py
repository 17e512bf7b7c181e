"""The data set: for each run a bag, a URDF, declared knowledge and the truth; a manifest with their SHA-256."""

import hashlib
import json
import re
import shutil
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.data import LEVELS, model, write_bag
from benchmarks.peers.conditions import KNOWN_PANEL, OTHER_ENGINE, Condition, declared, moved
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.urdf import replace_inertial
from mbaid_ros.replay.json_output import shaped
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import total_momentum

BAG, URDF, KNOWN, TRUTH = 'bag', 'robot.urdf', 'known.json', 'truth.json'
MANIFEST = 'manifest.json'
_FAR = 0.1  # how far the URDF's inertial of the target is off
_TORQUE = 0.01  # gain error of each joint's torque; noise of a reading, over the torque's root mean square


@dataclass(frozen=True)
class Run:
    """One recording."""

    condition: Condition
    seed: int
    seconds: float

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f'{re.sub(r"[^0-9A-Za-z]+", "_", self.condition.name)}-{self.seed}'


def make(runs: list[Run], folder: Path) -> dict[str, dict[str, str]]:
    """Make the runs that are not there, write the manifest, and return it: SHA-256 by run and file."""
    manifest = {}
    for run in runs:
        own = folder / run.name
        truth = own / TRUTH  # which is written last
        if not truth.is_file() or json.loads(truth.read_text(encoding='utf-8'))['seconds'] != run.seconds:
            shutil.rmtree(own, ignore_errors=True)
            _make(run, own)
        files = sorted(path for path in own.rglob('*') if path.suffix in {'.mcap', '.urdf', '.json'})
        manifest[run.name] = {
            str(path.relative_to(own)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files
        }
    _write(folder / MANIFEST, manifest)
    return manifest


def _make(run: Run, folder: Path) -> None:
    motion = moved(run.condition, run.seed, run.seconds)
    own, target = LEVELS[run.condition.level], model(run.condition.robot).last_link
    # Robots and levels draw apart, and what differs does, too.
    seed = zlib.crc32(run.condition.name.encode()) << 32 | run.seed
    rng = np.random.default_rng([seed, 1])
    truth = motion.truth
    if run.condition.differs == OTHER_ENGINE:
        effort = truth.joint_effort
        gain = 1.0 + _TORQUE * rng.normal(size=effort.shape[1])
        noise = _TORQUE * np.sqrt(np.mean(effort**2, axis=0)) * rng.normal(size=effort.shape)
        truth = replace(truth, joint_effort=gain * effort + noise)
    folder.mkdir(parents=True)
    write_bag(folder / BAG, motion.nominal, Sensors(own, seed, motion.errors), [(0.0, truth)])
    body = physical(motion.nominal.link(target).parameters)
    catalogued = _catalogued(body, rng)
    (folder / URDF).write_text(replace_inertial(motion.nominal.urdf, target, catalogued), encoding='utf-8')
    swings = run.condition.differs == KNOWN_PANEL
    # A panel at rest counts as fixed.
    robot = motion.moving if motion.moving.joints == motion.nominal.joints else motion.nominal
    momentum = total_momentum(robot, motion.truth[:1])[0]
    known = {
        'target_link': target,
        'noise': vars(own),
        'declared': declared(run.condition, run.seed),
        'passive_urdf': replace_inertial(motion.moving.urdf, target, catalogued) if swings else '',
        'momentum': momentum.tolist(),
    }
    _write(folder / KNOWN, known)
    about = {'condition': run.condition.name, 'seed': run.seed, 'seconds': run.seconds, 'target_link': target}
    bound = [float(value) if np.isfinite(value) else None for value in motion.bound]
    momenta = {'linear': momentum[:3].tolist(), 'angular': momentum[3:].tolist()}
    _write(folder / TRUTH, {**about, **shaped(body), 'parameters': body.tolist(), 'momentum': momenta, 'bound': bound})


def _catalogued(body: Array, rng: np.random.Generator) -> Array:
    """Return (10,) physical parameters that are 10 % off: mass, centre by that share of its radius of gyration."""
    mass, inertia = 1.0 + _FAR * rng.choice([-1.0, 1.0], 2)
    direction = rng.normal(size=3)
    gyration = np.sqrt(0.5 * (body[4] + body[7] + body[9]) / body[0])
    centre = body[1:4] + _FAR * gyration * direction / np.linalg.norm(direction)
    return np.concatenate(([mass * body[0]], centre, inertia * body[4:]))


def _write(file: Path, values: object) -> None:
    file.write_text(json.dumps(values, indent=2) + '\n', encoding='utf-8')


def manifest_digest(manifest: dict[str, dict[str, str]]) -> str:
    """Return the SHA-256 of a manifest, by which two data sets are compared."""
    return hashlib.sha256(json.dumps(manifest, sort_keys=True).encode()).hexdigest()
