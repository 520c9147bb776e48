"""Motions that make effects nameable, within what a robot may do; and what recordings lack."""
