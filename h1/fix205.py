import json,subprocess,sys,textwrap,re
R="/tmp/lead/dev/.venv/bin/ruff"
files=subprocess.run("git diff --name-only HEAD -- '*.py'",shell=True,capture_output=True,text=True).stdout.split()
if not files: sys.exit()
subprocess.run([R,"format","-q",*files])
for _ in range(40):
    out=json.loads(subprocess.run([R,"check","--output-format","json",*files],capture_output=True,text=True).stdout)
    todo=[o for o in out if o["code"]=="D205"]
    done=False
    for o in todo:
        p=o["filename"]; a=o["location"]["row"]-1
        L=open(p).read().split("\n")
        ind=re.match(r"\s*",L[a])[0]
        b=a+1
        while L[b].strip() and L[b].strip()!='"""' and not L[b].rstrip().endswith('"""'): b+=1
        para=" ".join(l.strip() for l in L[a:b])
        m=None
        for k in re.finditer(r"(?<=[.:]) (?=[A-Z`α])",para):
            first=para[:k.start()]
            if len(ind+first)<=110: m=k
            break
        if m is None or not para[:m.start()].endswith("."): continue
        first,rest=para[:m.start()],para[m.end():]
        tail=[]
        if L[b].rstrip().endswith('"""') and L[b].strip()!='"""':
            continue
        L[a:b]=[ind+first,""]+textwrap.wrap(rest,110,initial_indent=ind,subsequent_indent=ind,break_long_words=False,break_on_hyphens=False)
        open(p,"w").write("\n".join(L)); done=True; break
    if not done: break
out=json.loads(subprocess.run([R,"check","--output-format","json",*files],capture_output=True,text=True).stdout)
for o in out:
    p=o["filename"]; a=o["location"]["row"]-1
    print(o["code"],p.split("/h1/")[1],a+1)
    for l in open(p).read().split("\n")[a:a+4]: print("     ",l)
subprocess.run([R,"format","-q",*files])
