HELP="x"
def add_arguments(p): pass
def run(o): raise ValueError("not yet")
