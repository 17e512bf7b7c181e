"""The capture: before it the known model is put to the test, after it the captured body is identified.

Before the capture every body is known, the target link from its own <inertial>: each window of samples measures the
total momentum, which must be constant. After it the method of identification finds the total momentum of robot
and captured body together. The difference is the momentum of the captured body.
"""
