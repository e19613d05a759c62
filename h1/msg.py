def sub(p,a,b,n=1):
    s=open(p).read(); assert s.count(a)==n,(p,a,s.count(a)); open(p,"w").write(s.replace(a,b))
H="host/fltea/"
sub(H+"cli/exports.py",'''            f"--for {text}: give the time for which the heading has to hold, 0.1 to 1,000,000 s: {name}@300."
''','''            f"--for {text}: give the time up to which the heading's error must not be underestimated, 0.1 to "
            f"1,000,000 s: {name}@300."
''')
sub(H+"cli/identify_options.py",'''"matlab-imusensor or gnss-ins-sim. Noise that its settings cannot express is bounded for a "
            "heading of S seconds (60).",''','''"matlab-imusensor or gnss-ins-sim. If its settings cannot express some of the noise, they do not "
            "underestimate the heading's error over S seconds (60).",''')
sub(H+"cli/fleet.py",'''metavar="TIME", help="Time between fits of an axis that are kept; changes of verdict always are."''','''metavar="TIME", help="Least time between kept fits of an axis; a new verdict is always kept."''')
sub(H+"cli/fleet.py",'"Most sensors that are kept; further ones are counted."','"Most sensors that are kept; further sensors are only counted."')
sub(H+"cli/identify.py",'f"for one recording alone, {len(requests)} were given: {\', \'.join(for_one)}."','f"for one recording alone: {\', \'.join(for_one)}. You gave {len(requests)}."')
sub(H+"cli/app.py",'help="Order at the last sample: it varies linearly between."','help="Order at the last sample. It varies linearly from --alpha."')
sub(H+"cli/reproduce.py",'"`off` is the printed algorithm, which can diverge."','"`off` is the algorithm as the paper prints it, which can diverge."')
sub(H+"cli/reproduce.py",'''"Folder for PNGs, tables.md, and a CSV a table; with figures by default fltea-reproduce."''','''"Folder for PNGs, tables.md, and one CSV per table; default: fltea-reproduce if figures are made."''')
sub(H+"cluster/listing.py",'does the server make folders up? Name the one below"','does the server make folders up? Name a deeper folder"')
sub(H+"cluster/pieces.py",'ends {left} bytes before it did when it was listed.','is {left} bytes shorter than when it was listed.')
sub(H+"cluster/run.py",'''f"the worker's answer is none to what it was asked (a {type(result).__name__})"''','''f"the worker's answer (a {type(result).__name__}) does not belong to its task"''')
sub("tests/cluster/test_cluster_run.py",'''"the worker's answer is none to what it was asked" in row["error"]''','''"does not belong to its task" in row["error"]''')
sub(H+"estimator/snapshot.py",'its bias of {axis} cannot be ({bias:g})','its bias of {axis} is impossible ({bias:g})')
sub(H+"fleet/databases.py",'"what was written last is still under way"','"the transaction that was written last is still under way"')
sub(H+"identification/advice.py",'"The data are bad: mend that first; no figure holds before."','"The data are bad. Correct that first: until then no figure is valid."')
sub(H+"identification/comparison.py",'"Others whose intervals are known differ by no more than chance."','"Other figures whose intervals are known differ by no more than chance."')
sub("tests/identification/test_comparison.py",'"Others whose intervals are known differ by no more than chance."','"Other figures whose intervals are known differ by no more than chance."')
sub(H+"identification/data_checks.py",'{c.bridged} lost ones are filled in at random','{c.bridged} lost samples are filled in at random')
sub("tests/identification/test_identify_load.py",'3 lost ones are filled in','3 lost samples are filled in')
sub(H+"identification/data_checks.py",'''"Record without that filter: it is not linear, and corners and fast parts describe its shape.",''','''"Record without that filter: it is not linear, and corner frequencies and fast parts of the model "
            "describe the filter, not the sensor.",''')
sub(H+"identification/figures.py",'white noise of the same distribution, as of α."','white noise of the same distribution, as in the picture of α."')
sub(H+"identification/filter_figures.py",'''    more = "what it is" if ratio < 1.05 else f"{ratio:.2g} times what it is"
''','''    more = "as large as it is" if ratio < 1.05 else f"{ratio:.2g} times as large as it is"
''')
sub(H+"identification/filter_figures.py",'''since this program has no term of its own for that. The heading is off by "
        f"no more than that says, which is {more} after {duration(t_s)}."''','''since this program has no term of its own for that. So the heading's "
        f"error is not underestimated: after {duration(t_s)} these figures make it {more}."''')
sub(H+"identification/filter_figures.py",'"there is no state to have one"','"K is not known, and this is the correlation time of a state in place of it"')
sub(H+"identification/filter_figures.py",'"far above what a walk is used for"','"so long that the state acts as a random walk"')
sub(H+"identification/forecast.py",'"It holds for the samples as they are, behind the high-pass: the sensor itself drifts more."','"The forecast is for the samples as they are, after the high-pass: the sensor itself drifts more."')
sub(H+"identification/judges.py",'''sensors by turns in these rows, or rows computed between others? Choose "''','''sensors by turns in these rows, or rows computed from others? Choose "''')
sub(H+"identification/kalibr.py",'a record ten times as long tells a tenth of the bound"','with a record ten times as long the bound is a tenth"')
sub(H+"identification/data_sheet.py",'''f" Rounding to counts of {lsb:.3g} deg/s gives {counting:.2g} of it: choose a finer range."''','''f" Rounding to counts of {lsb:.3g} deg/s makes up {counting:.2g} of it: choose a finer range."''')
sub(H+"identification/forecast.py",'''f"the mean of the rate is {one.said:.2g} {unit} about it as predicted, {one.seen:.2g} {unit} as seen "
        f"({one.pieces} pieces)"''','''f"the σ of the rate's mean about it is {one.said:.2g} {unit} as predicted, {one.seen:.2g} {unit} as "
        f"seen ({one.pieces} pieces)"''')
sub("host/docs/guide/bias_and_heading.md","the mean of the rate is 0.0033 deg/s about it as predicted, 0.0034 deg/s as seen (30 pieces)","the σ of the rate's mean about it is 0.0033 deg/s as predicted, 0.0034 deg/s as seen (30 pieces)")
sub("tests/identification/test_forecast.py",'" Bias(10 s) holds: the mean of the rate is 0.0"','" Bias(10 s) holds: the σ of the rate\'s mean about it is 0.0"')
sub("tests/identification/test_forecast.py",'" s) fails: the mean of the rate is "','" s) fails: the σ of the rate\'s mean about it is "')
