"""Words that oppose one another, words of one meaning and words that forbid: English, German, French, Spanish, Chinese.

A language that is missing loses the oppositions between words; numbers and typed effects are still compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


_OPPOSITES = """
side: left leftward leftwards links linke linken linker linkes linkem gauche izquierda izquierdo 左
    左边 左侧 左手 左转 / right rightward rightwards rechts rechte rechten rechter rechtes rechtem droite
    derecha derecho 右 右边 右侧 右手 右转
height: above top up upper upward upwards over oben obere oberen oberer oberes oberhalb über
    aufwärts hinauf haut dessus arriba encima 上 上方 上面 / below bottom down lower downward downwards
    under underneath beneath unten untere unteren unterer unteres unterhalb unter abwärts hinunter
    bas dessous abajo debajo 下 下方 下面
depth: front forward forwards vorn vorne vorwärts  devant delante adelante 前面 前方 前 / back backward
    backwards behind rear rearward hinten rückwärts derrière arrière detrás atrás 后面 后方 后
inside: inside into  indoors innen hinein dedans dentro adentro 里面 内 / outside outdoors außen
    draußen hinaus dehors fuera afuera 外面 外
turning: clockwise uhrzeigersinn horaire horario 顺时针 / counterclockwise anticlockwise
    counter-clockwise anti-clockwise gegenuhrzeigersinn antihoraire antihorario 逆时针
opening: open opens opened opening öffne öffnen öffnet geöffnet aufmachen offen ouvre ouvrez ouvrir
    ouvert ouverte abre abrir abra abierto abierta 打开 张开 开启 敞开 / close closes closed closing shut
    shuts schließe schließen schließt geschlossen zumachen  ferme fermez fermer fermé fermée cierra
    cerrar cierre cerrado cerrada 关闭 合上 闭合 关上 关好
moving: push pushes pushed pushing shove slide drücke drücken schiebe schieben schiebt poussez
    pousser pousse empuja empujar empuje 推 / pull pulls pulled pulling drag tug ziehe ziehen zieht
    tirez tirer jala jalar  tirar 拉 拽
power:  enable enabled enables enabling activate activated active einschalten anschalten
    eingeschaltet aktivieren aktiviere aktiviert allumez allumer allume activer activez  enciende
    encender activa activar 启用 开灯 激活 打开电源 /  disable disabled disables disabling deactivate
    deactivated inactive ausschalten abschalten ausgeschaltet deaktivieren deaktiviere deaktiviert
    éteignez éteindre éteins désactiver désactivez apaga apagar desactiva desactivar 禁用 关灯 停用 关掉
running: start starts started starting begin launch resume starte starten gestartet démarrez
    démarrer démarre inicia iniciar arranca arrancar 启动 开始 / stop stops stopped stopping halt
    terminate kill pause stoppe stoppen anhalten beenden arrêtez arrêter arrête detén detener  parar
    termina 停止 终止
amount: increase increases increased increasing more  higher larger greater erhöhe erhöhen
    vergrößern mehr augmentez augmenter  aumenta aumentar más 增加 增大 提高 加大 / decrease decreases
    decreased decreasing reduce reduces reduced reducing fewer less shrink smaller verringere
    verringern reduziere reduzieren weniger réduisez réduire diminuez diminuer moins  reducir
    disminuye disminuir menos 减少 减小 降低
vertical: lift lifts lifted lifting raise raises raised raising elevate hebe heben hebt anheben
    hochheben gehoben soulève soulevez soulever levez  levanta levantar levante 抬高 抬起 举起 提起 升高 /
    lowers lowered lowering drop drops dropped dropping senke senken absenken gesenkt senkt abaissez
    abaisser baissez baisser baja bajar 放下 降下 下放
speed: accelerate fast quick quickly rapidly swiftly faster speedy schnell schneller rasch vite
    rapidement rapide rápido rápidamente deprisa 快 快速 迅速 / decelerate slow slowly slower langsam
    langsamer lentement lent despacio lentamente lento 慢 缓慢 慢慢 慢速
force: hard hart fest firmly forcefully strongly kräftig  fortement fermement fuerte firmemente 用力 /
    soft softly weich gently lightly sanft  doucement suavemente 轻轻 轻
level: high hoch hohe hoher hohes hohen haute  alto alta 高 / low niedrig niedrige niedriger
    niedriges tief basse faible  低
heat: hot warm heated heat heats heating heiß heißem heißes heißen warmes warmem chaud chaude
    caliente 热 加热 / cold cool cooled chill chilled chills cooling kalt kaltem kaltes kalten kühl
    kühlen froid froide frío fría 冷 冷却
wetness: wet moist nass feucht mouillé humide mojado húmedo 湿 / dry dried trocken trockenes  sèche
    seco seca 干
filling: full fill filled voll füllen plein pleine lleno llena 满 / empty emptied drain leer leere
    leeren vide vider vacío vacía vaciar 空
tension: tighten tightens tightened tight festziehen anziehen serrez serrer aprieta apretar 拧紧 收紧 /
    loosen loosens loosened loose lösen lockern desserrez desserrer afloja aflojar 拧松 松开
locking: lock locks locked locking verriegeln abschließen verrouillez verrouiller bloquea bloquear
    锁定 锁上 / unlock unlocks unlocked unlocking entriegeln aufschließen déverrouillez déverrouiller
    desbloquea desbloquear 解锁
joining: attach attached connect connected join mount mounted plug assemble verbinde verbinden
    anschließen montieren attachez attacher connectez connecter branchez monter conecta conectar
    montar 连接 安装上 挂载 / detach detached disconnect disconnected separate unmount unmounted unplug
    disassemble dismount trenne trennen demontieren détachez détacher déconnectez déconnecter
    débranchez démonter desconecta desconectar desmontar 断开 拆下 卸载
allowing: allow allows allowed permit permits permitted accept erlaube erlauben zulassen autorisez
    autoriser permettre permite permitir 允许 接受 / forbid forbids forbidden deny denies denied
    prohibit  reject verbiete verbieten ablehnen interdire interdisez prohíbe prohibir 拒绝
including: include includes included including einschließen inclure incluez incluye incluir 包括 包含 /
    exclude excludes excluded excluding ausschließen exclure excluez excluye excluir 排除
installing: install installs installed installing installiere installieren installez installer
    instala instalar 安装 / uninstall uninstalls uninstalled deinstalliere deinstallieren désinstallez
    désinstaller desinstala desinstalar
adding: add adds added adding insert inserts inserted append füge hinzufügen zugeben ajoutez ajouter
    ajoute insérez añade añadir agrega agregar inserta 添加 加入 插入 / remove removes removed removing
    delete deletes deleted deleting extract withdraw entferne entfernen löschen lösche retirez
    retirer supprimez supprimer quita quitar elimina eliminar retira 移除 删除 取出 去掉
order:  ascending aufsteigend croissant ascendente 升序 /  descending absteigend décroissant
    descendente 降序
axis: vertical vertically upright senkrecht verticalement  verticalmente 垂直 竖直 / horizontal
    horizontally  waagerecht waagrecht horizontalement horizontalmente 水平
sequence: parallel parallelly concurrently simultaneously gleichzeitig parallèle simultáneamente
    paralelo 并行 同时 / sequential sequentially serially serial nacheinander séquentiellement
    secuencialmente 顺序 依次 串行
timing: synchronous synchronously synchron / asynchronous asynchronously asynchron
truth: true yes wahr vrai verdadero 真 / false falsch faux falso 假
case: uppercase großbuchstaben majuscules mayúsculas / lowercase kleinbuchstaben minuscules
    minúsculas
indent: tab tabs tabulatoren / spaces leerzeichen
distance: near   nahe proche près cerca 近 靠近 / far away weit  loin lejos 远 远离
lateness: early earlier früh früher tôt temprano 早 / late later spät später tard tarde 晚
accepting:  approve approved genehmigen approuver aprobar 批准 /  refuse refused  refuser rechazar
keeping:  preserve retain behalten conserver conservar 保留 / discard  dispose verwerfen entsorgen
    jeter desechar 丢弃
locality: local locally lokal / remote remotely global globally
visibility: public öffentlich publique público / private privat privée privado
tilt:   straight gerade droit recto 直 / tilted bent crooked schräg incliné inclinado 倾斜
flow: encrypt encrypted verschlüsseln chiffrer cifrar 加密 / decrypt decrypted entschlüsseln
    déchiffrer descifrar 解密
packing: compress compressed zip pack komprimieren comprimir 压缩 / decompress uncompressed unzip
    unpack  entpacken descomprimir 解压
covering: cover covered bedecken couvrir cubrir 盖上 / uncover uncovered aufdecken découvrir destapar
    揭开
size: big large groß große großen grand grande gran grandes 大 / small little klein kleine kleinen
    petit petite pequeño pequeña 小
load: load loads loaded laden charger cargar / unload unloads unloaded entladen décharger descargar
light: bright  clair claro 亮 / dark dunkel sombre oscuro 暗
thickness: thick  épais grueso 厚 / thin dünn  fino 薄
length: long  longue largo 长 / short kurz kurze  courte corto 短
"""

_SAME = """
grasp: grasp grasps grasped grasping grab grip gripping clasp hold holds holding seize greife
    greifen greift halte halten saisir saisissez saisis attraper agarra agarrar coge coger sujeta 抓
    抓住 抓取 握住 拿起 夹住
turn: turn turns turned turning rotate rotates rotated rotating rotation twist twisting spin drehe
    drehen dreht gedreht tournez tourner tourne gira girar gire rota 旋转 转动 转 拧
place: place places placed placing lay lege legen stelle stellen posez poser  coloca colocar pon
    poner 放 放置
go: move moves moved moving go drive drives driving travel bewege bewegen fahre fahren déplacez
    déplacer bouge mueve mover conduce 移动
cup: cup cups tasse tassen taza tazas 杯子 杯
box: box boxes kiste schachtel boîte boîtes caja cajas 盒子 箱子
door: door doors tür türen porte portes puerta puertas 门
gripper: gripper grippers greifer pince pinza 夹爪 夹具
button: button buttons knopf taste bouton botón 按钮
check: check checks checked checking verify verifies inspect prüfe prüfen überprüfen vérifiez
    vérifier verifica verificar comprueba 检查
touch: touch touches touched touching contact berühre berühren touchez toucher toca tocar 触碰 触摸
press: press presses pressed pressing 按 按下
wait: wait waits waiting rest rests warte warten attendez attendre espera esperar 等待
cook: cook cooks cooking koche kochen cuire cuisez cocina cocinar 煮 烹饪
descend: descend descends descent   abstieg descendre descente descender 下降
run: run runs running execute executes executed ran ausführen exécuter exécutez ejecuta ejecutar 运行
    执行
directory: folder directory directories folders ordner verzeichnis dossier répertoire carpeta
    directorio 文件夹 目录
error: error failure fault fehler erreur fallo 错误
speedof: speed velocity geschwindigkeit vitesse velocidad 速度
"""

SOFT = _set(
    """
    set use uses used using make makes sure keep keeps keeping kept leave leaves get gets give take takes need needs
    needed must should shall always please better best good works work worked working succeed succeeded succeeds
    success fails failed ensure carefully properly safely exactly about around roughly approximately just simply
    prefer preferably recommended ideally usually often sometimes generally really amount value figure setting way
    side direction movement motion approx least most than per each every total own once again still there here well
    fine enough okay toward towards upon via along across onto  deep deeply while during being been gets
    lasse lassen verwende verwenden benutze benutzen nutze nutzen immer stets bitte muss müssen soll sollte sollen
    hat funktioniert vorher nachher dabei jeweils richtung seite etwas
    utilisez utiliser utilise toujours doit faut il mettre mettez laisse laissez fait faire côté direction vers jusque
    usa usar use utiliza utilizar siempre debe deben hay hacia lado deja dejar haz hacer 
    把 将 向 往 从 朝 用 使用 的 了 着 请 应 应该 必须 总是 要 需要 对 在 给 让 到 和 与 则 就 边 侧 时 个
    """
)
"""Words that change nothing about what is done to what."""

CONDITIONS = _set(
    "if when whenever while unless until once during falls wenn sobald während solange bis quand lorsque si pendant "
    "tant cuando mientras hasta 如果 当 若 当时"
)
"""What follows them says under which circumstances, not what to do."""

BEFORE = _set("before prior vor bevor ehe avant antes 之前 以前 前先")
AFTER = _set("after afterwards nach nachdem après después tras 之后 以后")
THEN = _set(
    "then afterwards next subsequently danach dann anschließend puis ensuite luego entonces 再 然后 接着"
)
FIRST = _set("first firstly zuerst zunächst  primero 先 首先")

NEGATORS = _set(
    """
    not never no don't dont doesn't mustn't shouldn't can't cannot won't avoid avoids avoiding refrain without
    nicht nie niemals kein keine keinen keinem keiner keines vermeide vermeiden ohne
    ne n pas jamais aucun aucune évitez éviter évite sans
    nunca jamás evita evitar evite sin
    不要 别 勿 切勿 禁止 避免 不能 不可 不得 从不 绝不 不 不应 不应该 没有 
    """
)
"""A clause with one of these forbids what it says, unless it is one of :data:`gvla2.memory.statements.IDIOMS`."""

TURNING = _set("turn turns turned turning switch switched switching power powered leave left")
STAYING = _set("keep keeps keeping stay stays remain remains")
IDENTIFIERS = _set(
    "step way line waypoint table example case lesson episode run seed code object item no number figure page chapter "
    "layer joint row column stage task issue test version option variant schritt zeile beispiel schritt ligne étape "
    "paso línea ejemplo 第 步 行"
)
"""A bare number after one of these names a thing and measures nothing."""

PARTICLE_VERBS = _set(
    "pick set clean look put lay speed slow back write warm heat cool grow clear close wash"
)
"""With these, "up" and "down" are part of the verb."""

PLACES = _set(
    "side hand arm gripper finger direction lane edge end corner half part way speed temperature water heat level rate "
    "pressure order priority seite hand arm richtung main bras côté mano brazo lado"
)
"""Before these, "the left" is where or how; before any other noun it says which one."""

DETERMINERS = _set(
    "the a an this that its your each die der das den dem eine einen le la les el los las un una"
)


def _table(text: str) -> tuple[dict[str, str], dict[str, tuple[str, int]]]:
    words: dict[str, str] = {}
    poles: dict[str, tuple[str, int]] = {}
    for line in text.strip().replace("\n    ", " ").split("\n"):
        name, _, rest = line.partition(":")
        groups = rest.split("/")
        for index, group in enumerate(groups):
            concept = f"{name}{'+-'[index]}" if len(groups) == 2 else name
            if len(groups) == 2:
                poles[concept] = (name, 1 - 2 * index)
            for word in group.casefold().split():
                words.setdefault(word, concept)
    return words, poles


_opposite_words, _poles = _table(_OPPOSITES)
_same_words, _ = _table(_SAME)
CONCEPTS: Mapping[str, str] = MappingProxyType({**_same_words, **_opposite_words})
"""Word -> the concept that it stands for, "axis+" or "axis-" where it has an opposite."""

POLES: Mapping[str, tuple[str, int]] = MappingProxyType(_poles)
"""Concept -> its axis and side."""

SEGMENTS: frozenset[str] = frozenset(
    word
    for words in (CONCEPTS, SOFT, CONDITIONS, BEFORE, AFTER, THEN, FIRST, NEGATORS)
    for word in words
    if "\u3400" <= word[0] <= "\u9fff"
)
"""The Chinese words of all the lists: scripts without spaces are cut by the longest of them."""
