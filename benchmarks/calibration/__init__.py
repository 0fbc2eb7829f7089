"""Whether what is learned of a car is as exact as it says, and what it is good for."""
