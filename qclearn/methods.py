raise ImportError("qclearn.methods of version 0.1 is now qclearn.benchmark.methods")
