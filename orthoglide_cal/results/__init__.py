"""Results for a technician: may the offsets be entered, which, how sure, what is left?"""
