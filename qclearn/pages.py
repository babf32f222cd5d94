raise ImportError(
    "qclearn.pages of version 0.1 is now qcbook, plots and scenes are qclearn.plot and "
    "qcbook.scenes"
)
