"""What is read and written: surfaces and values in the formats of the field, fsaverage5, where figures come from."""
