"""What recordings show by themselves: states, torques, an object's place, touches, lateness.

Nothing is searched here: whoever reads recordings, a diagnosis or an import, asks these first.
"""
