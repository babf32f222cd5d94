"""The graded exercises, one file each; `qclearn/exercises/exercise.py` says what such a file holds."""
