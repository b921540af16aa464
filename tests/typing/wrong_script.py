"""What type checkers tell of a user's mistakes: each line that ends in a remark has one."""

import tfm_cl as tfm

tfm.SpotLight(to=(0, 0, 0))  # wrong: no position
tfm.SpotLight(from_="above", to=(0, 0, 0))  # wrong: text is no position
tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0), zoom=2)  # wrong: no such field
tfm.Medium(sigma_s="red")  # wrong: text is no colour
tfm.HenyeyGreenstein("0.3")  # wrong: text is no number
tfm.MapSettings(storage="f64")  # wrong: no such type
tfm.PhaseMixture(phases=["rayleigh"])  # wrong: no weights
tfm.Scene("cloud.vdb")  # wrong: the name of a file is no body
brightness: float = tfm.Medium().sigma_s  # wrong: it is three numbers
