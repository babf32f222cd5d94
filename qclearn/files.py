raise ImportError("qclearn.files of version 0.1 is now qclearn.io")
