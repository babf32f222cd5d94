"""Programs that execute the pages and build the site, the copies, slides and sheets."""
