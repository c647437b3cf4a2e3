"""Who a starter is: asked (`first_contact`), compared (`fingerprint`), known before (`registry`)."""
