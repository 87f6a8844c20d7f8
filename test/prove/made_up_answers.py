"""Answers as `diagnose --json` writes them, with what the score looks at."""


def cause(term, option=0, probability=1.0, parameters=None):
    return {'term': term, 'option': option, 'probability': probability,
            'parameters': parameters or {}, 'applies_to': {}}


def answer(verdict, *causes, **other):
    return {'verdict': verdict, 'causes': list(causes), 'alternatives': [], 'where': [],
            'when': [], 'recalibrated': {}, 'fit': [], 'next_experiment': None,
            'sentence': 'A sentence.',
            'chance_of_what_is_left': 0.5, **other}


def record(given, mode='absolute', case='case_000'):
    return {'case': case, 'mode': mode, 'begun': 1, 'status': 'answered', 'seconds': 1.0,
            'words': '', 'confined': True, 'answer': given}


def effect(name, values, *, size=1.0, place=None, onset=None, **law):
    return {'name': name, 'size': size, 'values': values, 'place_m': place, 'onset_s': onset,
            **law}


def truth(*effects, kind='single', in_catalogue=True, alike=(), modulus=1.0):
    return {'labels': [e['name'] for e in effects], 'effects': list(effects), 'kind': kind,
            'in_catalogue': in_catalogue, 'solver': 'one', 'start_s': 0.5, 'E_kPa': 6.0,
            'alike': list(alike), 'nuisances': {'modulus_factor': modulus}}
