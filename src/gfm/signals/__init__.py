"""What recordings show by themselves: smooth states, torques, lateness, touches, doubts.

Nothing is searched here: whoever reads recordings, a diagnosis or an import, asks these first.
"""
