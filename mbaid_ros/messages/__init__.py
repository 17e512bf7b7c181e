"""Messages to arrays, many at a time: the objects of rclpy and rosbags alike, and bytes that were made into none."""
