"""A station with prepared shots, and controllers for it: the line tried out without cameras."""
