"""The ten parameters of a rigid body that estimates are of: their order, names and units."""

# Mass, centre of mass (link frame), inertia about it (link axes).
PARAMETERS = ('mass', 'com_x', 'com_y', 'com_z', 'ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
UNITS = ('kg', 'm', 'm', 'm', *('kg m^2',) * 6)
BAND = 1.96  # standard deviations either side that hold 95 % of a Gaussian
