"""Who a starter is: asked (`query`), compared (`fingerprint`), known from earlier runs (`registry`)."""
