"""What was published and cannot be used any more is taken back: from who reads one topic alone, and who comes late."""

from __future__ import annotations

import math

import numpy as np
from geometry_msgs.msg import InertiaStamped
from std_msgs.msg import String

from graph import Graph
from made_runs import BODY, estimate, planar
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.nodes.publication import Publishers
from mbaid_ros.nodes.subscriptions import LATCHED
from mbaid_ros.outgoing import Frames
from streams import urdf

FRAMES = Frames(target_link='link7', odometry='odom')


def test_numbers_that_are_contradicted_are_taken_back(graph: Graph) -> None:
    outlets, robot = Publishers(graph.node), urdf('servicer7')
    inertia = graph.collect('/test/inertia', InertiaStamped)
    outlets.publish(estimate(), FRAMES, robot)
    graph.wait(lambda: len(inertia) == 1, 'the numbers')
    outlets.publish(estimate(status='inconsistent', stamp=1_700_000_010_500_000_000), FRAMES, robot)
    outlets.publish(estimate(status='inconsistent', stamp=1_700_000_011_000_000_000), FRAMES, robot)
    late = graph.collect('/test/inertia', InertiaStamped, LATCHED)
    graph.wait(lambda: len(inertia) == 2 and late, 'that there are none')
    assert math.isnan(inertia[1].inertia.m)
    assert math.isnan(inertia[1].inertia.com.x)
    assert (inertia[1].header.stamp.sec, inertia[1].header.stamp.nanosec) == (1_700_000_010, 500_000_000)
    assert math.isnan(late[0].inertia.m)
    outlets.publish(estimate(), FRAMES, robot)
    graph.wait(lambda: len(inertia) == 3, 'numbers again, and the loss of the others told once')
    assert inertia[2].inertia.m == BODY[0]


def test_a_robot_description_that_is_contradicted_is_not_found_by_who_comes_late(graph: Graph) -> None:
    outlets, robot = Publishers(graph.node), urdf('servicer7')
    descriptions = graph.collect('/test/robot_description', String)
    heavier = np.concatenate(([200.0], BODY[1:]))
    outlets.publish(estimate(), FRAMES, robot)
    graph.wait(lambda: len(descriptions) == 1, 'the robot with the body')
    outlets.publish(estimate(status='inconsistent'), FRAMES, robot)
    late = graph.collect('/test/robot_description', String, LATCHED)
    outlets.publish(estimate(parameters=heavier), FRAMES, robot)
    graph.wait(lambda: late, 'the robot with another body')
    assert [load_model(one.data).link('link7').parameters[0] for one in late] == [200.0]
    # A body of which less is known than a link needs takes it back, too; what is known is still told.
    inertia = graph.collect('/test/inertia', InertiaStamped)
    outlets.publish(planar(), FRAMES, robot)
    later = graph.collect('/test/robot_description', String, LATCHED)
    outlets.publish(estimate(), FRAMES, robot)
    graph.wait(lambda: later and inertia and inertia[-1].inertia.iyy == BODY[7], 'the last')
    assert [load_model(one.data).link('link7').parameters[0] for one in later] == [BODY[0]]
