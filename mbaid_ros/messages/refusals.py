"""Why messages are not used, or not all that is in them."""

JOINT_MISSING = 'joint missing'
LENGTH_MISMATCH = 'names and values differ in number'
NOT_FINITE = 'NaN or infinite value'
NAMED_TWICE = 'joint named twice'
TOO_MANY_NAMES = 'more than 10000 names'
NOT_REAL = 'value beyond anything real'
WRONG_CHILD_FRAME = 'child_frame_id is no frame on the base'
BAD_QUATERNION = 'orientation is not a unit quaternion'
POSE_COVARIANCE = 'covariance of the pose is none'
TWIST_COVARIANCE = 'covariance of the twist is none'
