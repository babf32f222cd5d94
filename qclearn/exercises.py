raise ImportError("qclearn.exercises of version 0.1 is now qcbook.exercises")
