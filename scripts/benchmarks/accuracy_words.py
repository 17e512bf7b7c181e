"""What docs/accuracy.md says around its tables."""

INTRODUCTION = """\
# Accuracy

How far the estimates are from the truth, beside the smallest error that the data allow, and whether the intervals that
are reported hold what they promise. {provenance}
All robots here are exactly their URDF, and said to be; [model-errors.md](model-errors.md) has those that are not.

![Error over the bound and coverage]({figure})

The data: the robots of `config/`, moving as their `*_simulator.yaml` says; joints and odometry at 100 Hz with white
noise, fresh for every robot, level and seed. The base's pose and twist have 1 mm, 1e-4 rad, 1 mm/s and 1e-4 rad/s; the
encoders 1e-5 rad and 1e-4 rad/s (*low*), 1e-4 rad and 1e-3 rad/s (*mid*), or 1e-3 rad and 1e-2 rad/s (*high*). Each
run is one pass of 60 s; what it says after 2, 5, 10, 20 and 60 s is compared, of table1 after 20 and 60 s.

The bound is the Cramér-Rao bound of the model that takes each sample by itself: the momentum equations of every sample,
the noise of its sensors in all of their terms, unknown body and unknown total momentum (in the plane: four unknowns of
the body and three of momentum). A method that links the samples, as `trajectory` does, knows more and may lie below.
`paper_main` is *given* the true total angular momentum, and the methods of the paper assume that the linear momentum is
zero: they know things that the bound does not; their recursion, with its forgetting factor of 0.99 a sample, is the
paper's.
"""

ERRORS = """\
## Error over the bound

RMSE over the bound: the median over the parameters and (in brackets) the worst of them. A dash: the method determined
nothing in any run. A star: it published every parameter in fewer than half of the runs, chosen by what their estimates
looked like; method `difference unasked` of the script publishes all of them, however uncertain.
"""

INTERVALS = """\
## Reported uncertainty

How often the reported 95 % intervals hold the truth (over all parameters, and for the parameter with the fewest and
the most), and the error in the metric of the reported covariance (NEES, a parameter: 1 is right, more is
overconfident) with the band that holds 95 % of such averages. *Published*: the share of runs in which every parameter
was. *Converged*: the share with that status. *False alarms*: of all estimates up to then, those with the status
`inconsistent`, where nothing is wrong.
"""

UNITS = """\
## In units

RMSE at the end of the runs: mass, the CoM's worst coordinate, the inertia's worst element (relative to
sqrt(I_ii I_jj)).
"""

NOISE = """\
## Noise that is found

`trajectory, noise found` is told nothing of how noisy the sensors are: it uses what it finds in their readings. How far
that is from the truth, root mean square over the runs:
"""

LINKED = """\
## Over the bound of the whole trajectory

What any method could reach that links all samples is less than the per-sample bound above: RMSE of `trajectory` over
that limit, median (worst), and the limits themselves over the per-sample bound. They are computed from the information
of all sensors about body, momentum, first pose and the paths of the joints, cubic splines with a knot each second
(`scripts/benchmarks/trajectory_bound.py`).
"""

SENSORS = """\
## Fewer sensors, odometry whose errors are not white

*Poses alone*: joint positions and base poses without any velocity. *Wander*: the odometry's position walks randomly by
1 mm a square root of a second. *Correlated*: the errors of the poses are an autoregression with that time constant, as
large as ever, which nobody tells the estimator. *Outliers*: so many of the poses are 0.2 m and 5 degrees off. Odometry
*at 10 Hz* comes beside joint states at 100 Hz.
RMSE is over the per-sample bound with all sensors and white noise, median (worst); then, median, over the limit above
for the sensors that there are (with their correlation; as if outliers and wander were not).
"""

FRAMES = """\
## Drifting, and far from the origin

The same runs at *mid* noise, seen from a frame in which the system drifts, so that its linear momentum is not zero, or
with the base far from the odometry's origin. RMSE over the bound at the end of the runs, median (worst), over
{seeds} seeds in every row: the same seeds, so that rows of one robot can be compared closely.
"""
