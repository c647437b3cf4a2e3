-- EMQX 5: rules for the tables of ../postgresql/schema.sql. NOT RUN IN CI (EMQX is in no registry that CI has): written by its
-- documentation of rule SQL and of the PostgreSQL action. The second statement of each pair is the action's, and is valid
-- PostgreSQL: a test prepares it.
-- EMQX acknowledges before the row is committed: give the action a buffer on disk, or use ../postgresql/consumer.py.

-- rule: what (topic, boot, seq) names
SELECT topic, payload.boot AS boot, payload.seq AS seq, payload.time AS time,
       CASE WHEN is_null(payload.quality) THEN 'good' ELSE payload.quality END AS quality, payload
FROM "starters/+/starter/+/value/+", "starters/+/starter/+/state", "starters/+/starter/+/alarm/+",
     "starters/+/starter/+/event", "starters/+/starter/+/start", "starters/+/starter/+/trip",
     "starters/+/gateway/event", "starters/+/audit"

-- rule: values that come late, one row for each
FOREACH payload.items AS item
DO concat(regex_replace(topic, 'history$', 'value/'), item.point) AS topic, payload.boot AS boot, item.seq AS seq,
   item.time AS time, item.quality AS quality, item AS payload
FROM "starters/+/starter/+/history"

-- action of both
WITH began AS (
    INSERT INTO run SELECT ${boot}, ${time}::timestamptz WHERE ${time} IS NOT NULL AND ${quality} = 'good'
    ON CONFLICT (boot) DO UPDATE SET began = excluded.began WHERE excluded.began < run.began
)
INSERT INTO message (topic, boot, seq, time, payload)
VALUES (${topic}, ${boot}, ${seq}, ${time}::timestamptz, ${payload}::jsonb) ON CONFLICT DO NOTHING

-- rule: results
SELECT topic, CASE WHEN is_null(payload.id) THEN '' ELSE payload.id END AS id, payload.phase AS phase, payload.duplicate AS duplicate,
       payload.time AS time, payload
FROM "starters/+/result/+/+"

-- action
INSERT INTO result (topic, id, phase, duplicate, time, payload)
VALUES (${topic}, ${id}, ${phase}, ${duplicate}, ${time}::timestamptz, ${payload}::jsonb) ON CONFLICT DO NOTHING
