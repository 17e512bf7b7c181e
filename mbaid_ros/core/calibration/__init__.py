"""Any set of unknown bodies at once, from motions of a free-floating robot, with CAD values as a prior."""
