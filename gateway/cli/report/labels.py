"""The report's own words in the languages of our manuals; the English ones are the keys."""

from __future__ import annotations

from collections.abc import Callable

Translate = Callable[[str], str]

_WORDS: dict[str, tuple[str, str]] = {  # Spanish, Portuguese
    "Health report": ("Informe de estado", "Relatório de estado"),
    "Attention": ("Atención", "Atenção"),
    "Nothing unusual": ("Nada inusual", "Nada incomum"),
    "gateway": ("pasarela", "gateway"),
    "made": ("hecho", "feito"),
    "Identity": ("Identidad", "Identidade"),
    "Life": ("Vida", "Vida"),
    "Starts": ("Arranques", "Partidas"),
    "starts": ("arranques", "partidas"),
    "Start curves": ("Curvas de arranque", "Curvas de partida"),
    "Trends by month": ("Tendencias por mes", "Tendências por mês"),
    "Trips": ("Disparos", "Desligamentos"),
    "Changed parameters": ("Parámetros cambiados", "Parâmetros alterados"),
    "at the starter": ("en el arrancador", "no soft-starter"),
    "Line": ("Línea", "Linha"),
    "Notes": ("Notas", "Notas"),
    "starter": ("arrancador", "soft-starter"),
    "family": ("familia", "família"),
    "model": ("modelo", "modelo"),
    "firmware": ("firmware", "firmware"),
    "serial number": ("número de serie", "número de série"),
    "rated current": ("corriente nominal", "corrente nominal"),
    "line": ("línea", "linha"),
    "address": ("dirección", "endereço"),
    "operating hours": ("horas de servicio", "horas de operação"),
    "hours by load": ("horas por carga", "horas por carga"),
    "energy": ("energía", "energia"),
    "starts left this hour": ("arranques restantes en la hora", "partidas restantes nesta hora"),
    "pause left": ("pausa restante", "pausa restante"),
    "cool enough for a start in": ("frío para un arranque en", "frio para uma partida em"),
    "standstill": ("parado desde", "parado há"),
    "baseline": ("referencia", "referência"),
    "latest": ("último", "última"),
    "earlier": ("anteriores", "anteriores"),
    "median of": ("mediana de", "mediana de"),
    "median of the last": ("mediana de los últimos", "mediana das últimas"),
    "voltage": ("tensión", "tensão"),
    "dashed: baseline, shaded: within 15 % of it": (
        "trazos: referencia, sombreado: hasta 15 % de ella",
        "tracejado: referência, sombreado: até 15 % dela",
    ),
    "change": ("cambio", "mudança"),
    "last start": ("último arranque", "última partida"),
    "acceleration time": ("tiempo de aceleración", "tempo de aceleração"),
    "peak current": ("corriente máxima", "corrente de pico"),
    "heating": ("calentamiento", "aquecimento"),
    "current": ("corriente", "corrente"),
    "time": ("tiempo", "tempo"),
    "month": ("mes", "mês"),
    "outcome": ("resultado", "resultado"),
    "given by": ("dado por", "dada por"),
    "full voltage": ("plena tensión", "tensão plena"),
    "tripped": ("disparado", "desligada por falha"),
    "stopped": ("parado", "parada"),
    "given up": ("abandonado", "abandonada"),
    "fault": ("falla", "falha"),
    "state before": ("estado anterior", "estado anterior"),
    "parameter": ("parámetro", "parâmetro"),
    "before": ("antes", "antes"),
    "after": ("después", "depois"),
    "by": ("por", "por"),
    "none recorded": ("ninguno registrado", "nenhum registrado"),
    "asked": ("pedidas", "pedidas"),
    "answered": ("contestadas", "respondidas"),
    "silent": ("sin respuesta", "sem resposta"),
    "corrupted": ("dañadas", "corrompidas"),
    "late": ("tardías", "atrasadas"),
    "lost": ("perdidas", "perdidas"),
    "refused": ("rechazadas", "recusadas"),
    "errors lately": ("errores recientes", "erros recentes"),
    "replies": ("respuestas", "respostas"),
    "response time": ("tiempo de respuesta", "tempo de resposta"),
    "the cable looks good": ("el cable parece bueno", "o cabo parece bom"),
    "trips": ("disparos", "desligamentos"),
    "of the last 20 starts": ("de los últimos 20 arranques", "das últimas 20 partidas"),
}
_COLUMN = {"es": 0, "pt": 1}


def translator(language: str) -> Translate:
    """Return what puts a word of the report into a language; what it does not know stays English."""
    column = _COLUMN.get(language)
    if column is None:
        return lambda word: word
    return lambda word: _WORDS[word][column] if word in _WORDS else word
