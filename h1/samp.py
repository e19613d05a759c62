import sys; sys.path.insert(0,"/tmp/lead")
import texts
from pathlib import Path
lot=[Path(l) for l in open("/tmp/lead/lot1.txt").read().split()]
texts.all_files=lambda: lot
texts.sample(sys.argv[1],sys.argv[2])
