import sys,random; sys.path.insert(0,"/tmp/lead")
import texts
from pathlib import Path
lot=[Path(l) for l in open("/tmp/lead/lot1.txt").read().split()]
texts.all_files=lambda: lot
class R(random.Random):
    def sample(self,got,n): return [g for g in got if g[2].startswith("message:")]
texts.random.Random=R
texts.sample("1","1")
