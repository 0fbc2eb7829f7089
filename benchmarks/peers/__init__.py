"""The same filters on the same data, written with roadstate, in C and with other libraries, side by side."""
