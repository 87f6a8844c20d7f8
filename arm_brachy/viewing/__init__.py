"""What a viewer shows of the cell, as plain shapes: nothing here knows ROS or a screen."""
